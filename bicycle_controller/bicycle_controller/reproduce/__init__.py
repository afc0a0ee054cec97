"""The paper's experiments, one declarative file each, run by one runner.

experiment.py   content of a file of `figures/`
training.py     its training runs
riding.py       its rides without noise
tables.py       CSV files with the raw data
summary.py      numbers computed from them
pictures.py, curves.py, ways.py     the figures
claims.py       verdicts on the paper's claims
results.py      RESULTS.md
"""
