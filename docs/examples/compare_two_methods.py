# %% [markdown]
# # Compare two methods
#
# Does halving design better control software than random search, with the same budget? Each method makes four designs;
# each design is assessed on the same 20 fresh instances. The design is the unit: its 20 runs are not independent
# evidence on the method that made it.

# %%
import mercator_design as md
from mercator_design.show.study.verdicts import headlines
from mercator_design.studies.analysis import analysed

# %%
plan = {
    "name": "two methods",
    "budgets": [80],
    "repetitions": 4,
    "methods": {"halving": {}, "random": {"method": "random"}},
    "missions": [
        {"mission": "aggregation", "set": ["robots=4", "duration=20"]},
        {"mission": "grid_exploration", "set": ["robots=4", "duration=20"]},
    ],
    "assess": {"runs": 20},
}
table = md.study(plan, folder="two-methods")
print(table.designs)

# %% [markdown]
# The mean of each method over its designs, and how far designs of one method lie apart:

# %%
means = table.designs.groupby(["mission", "method"])["score"].agg(["mean", "std", "count"])
print(means)

# %% [markdown]
# What the tests say of it, in a sentence each. Four designs of each method show large differences only.

# %%
results = analysed(table)
for sentence in headlines(results):
    print(sentence)

# %% [markdown]
# More designs need no new study. Only the new ones run:

# %%
larger = md.study({**plan, "repetitions": 5}, folder="two-methods")
print(len(larger.designs) - len(table.designs))
