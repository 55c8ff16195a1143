"""BLAS threads: small factorisations run several times slower when BLAS splits them over cores."""

from __future__ import annotations

from typing import Any

from threadpoolctl import ThreadpoolController

_controller: ThreadpoolController | None = None


def one_blas_thread() -> Any:
    """Context in which BLAS uses one thread, whatever the user's environment says."""
    global _controller
    if _controller is None:
        _controller = ThreadpoolController()
    return _controller.limit(limits=1, user_api="blas")
