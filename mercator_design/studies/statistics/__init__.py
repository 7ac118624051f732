"""The statistics of studies: tests of ranks, effect sizes, what a number of designs can show, findings on a table."""
