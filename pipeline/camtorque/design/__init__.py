"""A better cam: free quantities, aims and limits -> Pareto front, chosen cam, what each limit costs, tolerances.

::

    DESIGN.toml -> task -> problem (variables, evaluate, responses) -> solver -> front -> answer -> page, files
                                                                explain: prices, limits that collide
                                                                tolerances: cams drawn at random
"""

from camtorque.design.answer import Answer, answer_document, solve_task, write_chosen
from camtorque.design.page import design_page
from camtorque.design.task import Task, read_task
