"""Random mechanisms are too many to compile: they run in the virtual machine, whose equality is tested elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="module")
def virtual_machine() -> Iterator[None]:
    """Hide the compiler."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PARAOPT_COMPILE", "0")
        yield
