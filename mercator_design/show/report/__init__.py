"""report.html: the course of a race, and the comparison of its winner with others, in one file that needs nothing else.

facts       the facts that the page shows, read from the run folder
markup      headings, figures, tables
answer      the winner and its score
request     the request: mission, method, budget
course      budget, best configuration, convergence, elites
comparison  the winner and others on fresh instances; the elites in the race
importance  which modules explain the scores
replays     the winner's median, best and worst run
origin      failures, versions, commands
page        the whole page, and its file
follow      serves the page of a race that is running
"""
