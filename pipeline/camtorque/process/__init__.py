"""Processes, threads and what the operating system does to them.

caches           where numba and matplotlib keep theirs
stopping         Ctrl-C and termination
system           what the system refuses, in words; standard streams
threads          threads of this process
second_process   half of the work in a fork
workers          a pool of processes
"""
