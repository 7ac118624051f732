"""Run folders: what a race leaves behind.

folder        what is in a run folder, in which order it appears, and how a race resumes
provenance    who ran what, where, with which versions
files         a run folder, read
tables        its experiments, tests and configurations as tables
verification  whether it is what it says
"""
