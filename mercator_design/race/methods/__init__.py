"""Optimizers, one in each file: halving, iterated race, search, Optuna's samplers; `table` names them."""
