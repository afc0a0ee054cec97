"""The paper's experiments, one declarative file each, run by one runner.

experiment.py   what a file of `figures/` says
training.py     its training runs
riding.py       its rides without noise
tables.py       the CSV files that hold the raw data
summary.py      the numbers that follow from them
pictures.py, curves.py, ways.py     the figures
claims.py       whether the paper's claim held
results.py      RESULTS.md
"""
