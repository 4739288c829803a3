"""`terrapin compare CASE`: is the model of a case good enough for its measurements, and where does it fail?"""

from __future__ import annotations

from terrapin_tools.command_options import Cases, Cluster, Jobs, Json, Level, Seed, check_options, deliver
from terrapin_tools.progress import step

__all__ = ["compare"]


def compare(
    case: Cases, json: Json = "", seed: Seed = 0, jobs: Jobs = 1, level: Level = 0.05, cluster: Cluster = ""
) -> None:
    """Fit the model on the training runs, predict every run, say whether anything is missing and where it fails.

    A folder of cases is answered case by case, in sorted order: with --json one line each.

    Example: terrapin compare cases/forced_slip_sand --json answer.json
    """
    from terrapin_tools.workbench.fleet import fleet
    from terrapin_tools.workbench.story.answer import answer
    from terrapin_tools.workbench.story.terminal import tell

    check_options(seed, jobs, level)
    question = fleet.Question("compare", seed, level)
    folders = fleet.cases_in(case)
    if folders is not None:
        from terrapin_tools.workbench.fleet.lines import answer_all

        answer_all(folders, question, json, jobs, cluster, lambda folder, story: None)
        return
    with step("compare"):
        story = fleet.answer_one(case, question, cluster)
    deliver(answer(story), tell(story), json)
