"""What pictures and pages read of a diagnosis and a refinement, which are made on a floor above."""

from __future__ import annotations

from typing import Any, Protocol

import pandas as pd


class DiagnosisLike(Protocol):
    """See `thermocorr.Diagnosis`."""

    verdict: str
    noise_floor: float
    explainable: float
    where: pd.DataFrame
    allan: pd.DataFrame
    ranking: pd.DataFrame
    suspects: tuple[Any, ...]
    best: Any
    residual_rms: float
    colour: float
    unit: str
    level: float
    data: Any


class RefinementLike(Protocol):
    """See `thermocorr.Refinement`."""

    steps: pd.DataFrame
    model_: Any
    diagnoses: tuple[Any, ...]
