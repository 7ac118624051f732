# %% [markdown]
# # How much of a design survives another reality?
#
# Designs are assessed in the robot model in which they were made, in a pseudo-reality that was chosen by hand, and in
# pseudo-realities that are sampled around the design model, in ranges that become wider.

# %%
import mercator_design as md

# %%
widths = [0.5, 1.0, 2.0]
table = md.study(
    {
        "name": "reality gap",
        "budgets": [80],
        "repetitions": 3,
        "methods": {"halving": {}},
        "missions": [{"mission": "aggregation", "set": ["robots=4", "duration=20"]}],
        "assess": {
            "runs": 20,
            "realities": ["mercator-pseudo-reality", *({"sample": 10, "width": width} for width in widths)],
        },
    }
)

# %% [markdown]
# The score of each design in each reality, and what is left of that in the design model:

# %%
scores = table.designs.pivot(index="repetition", columns="reality", values="score")
left = scores.div(scores["design"], axis=0).mean()
print(left)

# %% [markdown]
# Instance k of each design ran in sample k mod 10 of a width, so the runs show how far samples lie apart:

# %%
sampled = table.runs[table.runs["reality"] == "sampled-2"]
by_sample = sampled.groupby(sampled["instance"] % 10)["score"].mean()
print(by_sample)
