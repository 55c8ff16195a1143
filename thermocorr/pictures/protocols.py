"""What pictures and pages read of a diagnosis and a refinement, which are made on a floor above."""

from __future__ import annotations

from typing import Any, Protocol

import pandas as pd


class DiagnosisLike(Protocol):
    """What is shown of a `thermocorr.Diagnosis`, where each of these is explained."""

    @property
    def verdict(self) -> str: ...  # noqa: D102

    @property
    def noise_floor(self) -> float: ...  # noqa: D102

    @property
    def explainable(self) -> float: ...  # noqa: D102

    @property
    def where(self) -> pd.DataFrame: ...  # noqa: D102

    @property
    def ranking(self) -> pd.DataFrame: ...  # noqa: D102

    @property
    def suspects(self) -> tuple[Any, ...]: ...  # noqa: D102

    @property
    def causes(self) -> tuple[Any, ...]: ...  # noqa: D102

    @property
    def small(self) -> tuple[Any, ...]: ...  # noqa: D102

    @property
    def left(self) -> Any: ...  # noqa: D102

    @property
    def best(self) -> Any: ...  # noqa: D102

    @property
    def residual_rms(self) -> float: ...  # noqa: D102

    @property
    def unit(self) -> str: ...  # noqa: D102

    @property
    def level(self) -> float: ...  # noqa: D102

    @property
    def data(self) -> Any: ...  # noqa: D102


class RefinementLike(Protocol):
    """What is shown of a `thermocorr.Refinement`, where each of these is explained."""

    @property
    def steps(self) -> pd.DataFrame: ...  # noqa: D102

    @property
    def diagnoses(self) -> tuple[DiagnosisLike, ...]: ...  # noqa: D102

    @property
    def model_(self) -> Any: ...  # noqa: D102
