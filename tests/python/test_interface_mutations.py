"""A spread of the mutants of controller.toml and of its generator; all: `python -m tests.interface_mutations`."""

from __future__ import annotations

import pytest

from tests.interface_mutations import description_mutants, generator_mutants
from tests.interface_mutations.__main__ import short


def test_there_are_enough() -> None:
    assert len(description_mutants.MUTANTS) >= 200
    assert {m.field for m in description_mutants.MUTANTS} == {"scale", "offset", "length", "start"}
    assert len(generator_mutants.MUTANTS) >= 40


@pytest.mark.parametrize("mutant", short("description"), ids=lambda mutant: mutant.name)
def test_a_changed_description_is_right_or_refused(mutant: description_mutants.Mutant) -> None:
    good, told = description_mutants.judge(mutant)
    assert good, told


@pytest.mark.parametrize("mutant", short("generator"), ids=lambda mutant: f"{mutant.module}-{mutant.number}")
def test_a_changed_generator_is_caught(mutant: generator_mutants.Mutant) -> None:
    caught, told = generator_mutants.judge(mutant)
    assert caught, f"{mutant.name}: {told}"


def test_every_equivalent_is_a_mutant() -> None:
    """None is excused that is not there any more."""
    assert set(generator_mutants.EQUIVALENT) <= {mutant.what for mutant in generator_mutants.MUTANTS}


@pytest.mark.parametrize(
    ("field", "old", "new"), [("scale", "0.02", "0.04"), ("length", "15", "14"), ("start", "31", "30")]
)
def test_the_oracle_sees_a_number_that_stands_twice(monkeypatch, field: str, old: str, new: str) -> None:
    """Had the C or a decoder its own idea of one number, the mutant would be found: here what is generated is of the
    description as it was, and is held against the changed one."""
    mutant = description_mutants.Mutant("ELECTRICAL", "temperature", field, old, new)
    text = mutant.text()
    monkeypatch.setattr(description_mutants.Mutant, "text", lambda self: description_mutants.TEXT)
    judged = description_mutants.wrong
    monkeypatch.setattr(description_mutants, "wrong", lambda _, *others: judged(text, *others))
    good, told = description_mutants.judge(mutant)
    assert not good, told
