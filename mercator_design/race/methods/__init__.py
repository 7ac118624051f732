"""Optimizers, one in each file: iterated race, search, surrogate, Optuna's samplers; `table` names them."""
