"""Trade-offs of the settings: error against time with the defaults marked, from the records of the benchmarks.

- `knee`: the option of a curve where more time begins to buy too little
- `curve`: options, curves and settings, as every part here takes them
- `knobs`: which settings are shown, where their records are, and why a default may lie off the knee
- `figure`, `page`: the figures, and the page docs/benchmarks.md (`make bench`)
"""
