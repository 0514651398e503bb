"""Train a classifier on a data set of gridfold: which samples stay stable.

``python train.py plan.samples``: prints how often it is right about samples that it has not seen.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
from sklearn.ensemble import RandomForestClassifier
from sklearn.model_selection import train_test_split

#: Inputs that are numbers; which fault it is goes in as one column for each fault.
NUMBERS = [
    "load_area_1",
    "load_elsewhere",
    "exchange_mw",
    "inertia_area_1",
    "clearing_time",
    "load_mw",
    "slack_mw",
    "start_lowest_voltage",
]


def read(folder: Path) -> tuple[pd.DataFrame, pd.Series]:
    """Inputs and labels of the samples that could be simulated."""
    frame = pd.read_parquet(folder / "samples")
    frame = frame[frame["stable"].notna()]  # infeasible samples have no label
    faults = pd.get_dummies(frame["contingency"], dtype=float)
    return frame[NUMBERS].join(faults), frame["stable"].astype(bool)


def train(inputs: pd.DataFrame, stable: pd.Series) -> tuple[float, float]:
    """How often a forest is right about samples that it has not seen, and how often a constant is."""
    seen, unseen, labels, right = train_test_split(
        inputs, stable, test_size=0.25, random_state=1, stratify=stable
    )
    forest = RandomForestClassifier(300, random_state=1).fit(seen, labels)
    constant = max(right.mean(), 1 - right.mean())
    return float(forest.score(unseen, right)), float(constant)


def main() -> None:
    """Train on the data set that the command line names."""
    inputs, stable = read(Path(sys.argv[1]))
    forest, constant = train(inputs, stable)
    print(f"{len(stable)} samples, {stable.mean():.0%} of them stable")
    print(f"right about unseen samples: {forest:.0%}; always the same answer: {constant:.0%}")


if __name__ == "__main__":
    main()
