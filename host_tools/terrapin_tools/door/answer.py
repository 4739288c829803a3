"""What compare and discover answer about a case, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

from terrapin_tools.door.effect import Effect
from terrapin_tools.door.named import Named

if TYPE_CHECKING:
    from terrapin_tools.workbench.compare.intervals import Interval
    from terrapin_tools.workbench.story.story import Story, Value

__all__ = ["Answer", "in_a_program"]


@final
class Answer:
    """The verdict on a case, of `Case.compare` or `Case.discover`: immutable, and goes to another process as it is.

    In a notebook it is the card of the page, in a terminal three lines; `print` shows all that `terrapin` prints, with
    the next call in place of the next command.

    >>> answer = Case.example("heated_motor").compare()
    >>> answer.verdict, answer.missing
    ('missing', ())
    """

    __slots__ = ("_story",)

    def __init__(self, story: Story) -> None:
        self._story = story

    @property
    def verdict(self) -> str:
        """`adequate`, `missing`, `ambiguous`, `partial` or `unexplained`."""
        return self._story.verdict

    @property
    def missing(self) -> tuple[Effect, ...]:
        """What the model lacks, what takes most first, for `Case.add`; none for an answer of compare."""
        found = self._story.found
        if found is None:
            return ()
        own = {one.effect: one.own for one in found.candidates if one.kind in ("expression", "table")}
        return tuple(Effect._of(name, own.get(name)) for name in found.missing)

    @property
    def probability(self) -> float | None:
        """That exactly this is missing (adequate: that nothing is); None for an answer of compare."""
        return None if self._story.found is None else self._story.found.probability

    @property
    def p_value(self) -> float:
        """Of the test whether anything is missing; `level` is its false alarm rate."""
        return self._story.p_value

    @property
    def level(self) -> float:
        """False alarm rate of the verdict."""
        return self._story.level

    @property
    def candidates(self) -> dict[Effect, float]:
        """Effects and the probability that each is part of what is missing, likeliest first."""
        found = self._story.found
        if found is None:
            return {}
        kinds = ("expression", "table")
        return {
            Effect._of(one.effect, one.own if one.kind in kinds else None): one.probability for one in found.candidates
        }

    @property
    def rivals(self) -> tuple[tuple[str, ...], ...]:
        """Sets of effects that do about as well."""
        return () if self._story.found is None else self._story.found.rivals

    @property
    def parameters(self) -> Mapping[str, Value]:
        """Fitted parameters by name: `value`, `sd` and the bounds `min` and `max` in `unit`, None where there is none;
        `at_bound`: it ended at one."""
        return Named(self._story.parameters, "parameters")

    @property
    def intervals(self) -> Mapping[str, Interval]:
        """Profile intervals at 95 % by parameter, of `Case.compare(intervals=True)`: `low` and `high` in `unit`, None
        where a side does not close; `ends` says why; `correlation` with the `partner` it is most correlated with.

        >>> answer = Case.example("forced_slip_sand").compare(intervals=True)
        >>> answer.intervals["k_s"].ends
        ('closes', 'closes')
        """
        return Named(self._story.intervals, "intervals")

    @property
    def headline(self) -> str:
        """The answer in a sentence."""
        return self._story.headline

    @property
    def next(self) -> str:
        """What to do next, in a sentence."""
        return self._story.next.text

    @property
    def next_experiment(self) -> Mapping[str, Any] | None:
        """What tells the rivals apart, as `terrapin discover CASE --json -` has it; None where nothing does."""
        plan = self._story.found.plan if self._story.found else None
        return dict(vars(plan)) if plan else None

    @property
    def seconds(self) -> float:
        """That the answer took; not compared."""
        return self._story.seconds

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON (docs/cases.md) as Python objects."""
        from terrapin_tools.workbench.story.answer import answer

        return answer(self._story)

    def json(self) -> str:
        """What the command line writes with --json."""
        from terrapin_tools.workbench.files.json_text import to_json

        return to_json(self.as_dict())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Answer):
            return NotImplemented
        return {**self.as_dict(), "seconds": 0} == {**other.as_dict(), "seconds": 0}

    def __hash__(self) -> int:
        return hash((self._story.title, self.verdict, self.p_value))

    def __reduce__(self) -> Any:
        return Answer, (self._story,)

    def __str__(self) -> str:
        from terrapin_tools.workbench.story.terminal import tell

        return tell(in_a_program(self._story))

    def __repr__(self) -> str:
        from terrapin_tools.door.card import as_lines

        return "\n".join(as_lines(self._story))

    def __rich__(self) -> Any:
        from rich.text import Text

        return Text(repr(self))

    def _repr_html_(self) -> str:
        from terrapin_tools.door.card import as_html

        return as_html(self._story)


def in_a_program(story: Story) -> Story:
    """The story as a program goes on with it: its case is in memory, where no command finds it."""
    step = story.next
    if not step.command:
        return story
    call = "case.discover()" if step.do == "discover" else "case.add(answer.missing)"
    return replace(story, next=replace(step, command=call))
