"""irace's files, read and obeyed: parameters, configurations, scenario, target runner; `tuner` races them."""
