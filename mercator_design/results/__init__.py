"""Run folders: the results of races.

folder        creates, resumes and completes a run folder
provenance    versions, request and machine of a race
files         reads a run folder
tables        experiments, tests and configurations as tables
verification  checks a run folder
"""
