"""Which values, how sure, which losses are needed: problem, search, solver, evidence, uncertainty, result.

Nothing is imported here: what `check` needs of this room, `prepare`, costs a tenth of the room.
"""
