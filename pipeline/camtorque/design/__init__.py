"""A better cam: free quantities, aims and limits -> Pareto front, chosen cam, what each limit costs, tolerances.

::

    DESIGN.toml -> task -> problem (variables, responses) -> solver -> front -> answer: files, page
                                                                     explain: prices, limits that collide, tolerances
"""

from camtorque.design.answer import Answer, answer_document, design_page, solve_task, write_chosen
from camtorque.design.task import Task, read_task
