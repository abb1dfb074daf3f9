"""A compiled kernel says what it was built from, and one of other sources is refused."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import annik_core.kernel
from annik_core.kernel import StaleKernel, compiled_kernel
from annik_core.kernel.sources import sources_hash

FOLDER = Path(annik_core.kernel.__file__).parent
HERE = sources_hash(FOLDER)


@pytest.fixture(autouse=True)
def loaded_anew(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("ANNIK_KERNEL", raising=False)
    compiled_kernel.cache_clear()
    yield
    compiled_kernel.cache_clear()


def give(monkeypatch: pytest.MonkeyPatch, **attributes: str) -> SimpleNamespace:
    """A kernel, in place of the one that is built."""
    kernel = SimpleNamespace(__file__=str(FOLDER / "compiled.so"), **attributes)
    monkeypatch.setitem(sys.modules, "annik_core.kernel.compiled", kernel)
    return kernel


@pytest.mark.parametrize("attributes", [{"sources": "0" * 64}, {}], ids=["other", "before 0.2"])
def test_a_kernel_of_other_sources_is_refused(monkeypatch, attributes):
    kernel = give(monkeypatch, **attributes)
    with pytest.raises(StaleKernel) as caught:
        compiled_kernel()
    assert caught.value.path == Path(kernel.__file__)
    assert caught.value.sources == HERE != caught.value.built_from
    assert "./run setup" in caught.value.remedy
    monkeypatch.setenv("ANNIK_KERNEL", "off")
    assert compiled_kernel() is None


@pytest.mark.parametrize("sources", [HERE, ""], ids=["of these", "compiled by hand"])
def test_a_kernel_that_may_be_of_these_sources_is_used(monkeypatch, sources):
    kernel = give(monkeypatch, sources=sources)
    assert compiled_kernel() is kernel


def test_an_installation_without_sources_is_not_compared(monkeypatch):
    kernel = give(monkeypatch, sources="0" * 64)
    monkeypatch.setattr(annik_core.kernel, "sources_hash", lambda _: "")
    assert compiled_kernel() is kernel


def test_the_hash_changes_with_the_sources_alone(tmp_path):
    assert sources_hash(tmp_path) == ""
    (tmp_path / "a.hpp").write_bytes(b"1")
    (tmp_path / "notes.txt").write_bytes(b"2")
    first = sources_hash(tmp_path)
    (tmp_path / "notes.txt").write_bytes(b"3")
    assert sources_hash(tmp_path) == first
    (tmp_path / "b.cpp").write_bytes(b"4")
    assert sources_hash(tmp_path) not in ("", first)
