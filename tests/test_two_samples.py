"""The family of tests of a benchmark."""

from benchmarks.two_samples import rejected


def test_benjamini_and_hochberg():
    ps = (0.03, 0.0004, 0.0041, 0.0058, 0.5)
    assert rejected(ps, 0.01) == [1, 2, 3]
    assert rejected(ps, 0.001) == []
    assert rejected([], 0.01) == []
