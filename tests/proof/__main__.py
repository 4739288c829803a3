"""What is shown of the firmware by tools, and not by tests: `make proof`. docs/proof.md says what, and what is assumed.

    python -m tests.proof               all proofs; status 1 when one fails or takes too long
    python -m tests.proof --planted     the same on sources with a planted defect each: every one must raise an alarm
    python -m tests.proof supervisor    those of this name

CBMC (tests/setup/cbmc.sh) takes the C as it is; z3 (tests/proof/requirements.txt) the arithmetic as exact integers. A
tool that is not there is named: what it would have shown is not shown then.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

from terrapin_hil import paths
from terrapin_hil.messages import interface
from terrapin_hil.paths import ROOT

HERE = Path(__file__).resolve().parent
SECONDS = 60.0  # of processor time that one proof may take; ten times as long by the clock
CHECKS = (
    "--bounds-check", "--pointer-check", "--pointer-overflow-check", "--div-by-zero-check", "--signed-overflow-check",
    "--undefined-shift-check", "--unwinding-assertions",
)  # fmt: skip


@dataclass(frozen=True)
class Proof:
    """A harness prove_NAME.c; how often its longest loop turns; defects in a source, each of which it must notice.

    `alone`: functions of the source which the harness has contracts for, and proves on their own as NAME_itself.
    """

    name: str
    turns: int
    source: str
    defects: tuple[tuple[str, str], ...]
    options: tuple[str, ...] = ()
    alone: tuple[str, ...] = ()


PROOFS = (
    Proof("supervisor", 3, "core/supervisor.c", (
        ("causes |= fault_bit(TERRAPIN_FAULT_ESTOP);", ""),
        ("if (latched) {", "if (latched && (s->state != TERRAPIN_STATE_RUN)) {"),
        ("const uint32_t kept = clear ? 0U :", "const uint32_t kept = (s->request == TERRAPIN_REQUEST_CLEAR) ? 0U :"),
        ("driving(s->state) && command_late(state)", "(s->state == TERRAPIN_STATE_RUN) && command_late(state)"),
        ("(s->hold_ms > 0U) && (s->request_taken != TERRAPIN_REQUEST_CLEAR)", "s->hold_ms > 0U"),
        ("if (!starts) {", "if (request == TERRAPIN_REQUEST_IDLE) {"),
    )),
    Proof("slcan", 35, "link/slcan.c", (
        ("parser->length < TERRAPIN_SLCAN_LINE_MAX", "parser->length <= TERRAPIN_SLCAN_LINE_MAX"),
    )),
    Proof("intake", 35, "link/intake.c", (
        ("if (intake->count == TERRAPIN_INTAKE_SIZE) {", "if (intake->count > TERRAPIN_INTAKE_SIZE) {"),
        ("(intake->first + intake->count) % TERRAPIN_INTAKE_SIZE", "intake->first + intake->count"),
    )),
    Proof("command", 10, "link/command.c", (
        ("} else if (!sealed && (link->seal.key != NULL)) {", "} else if (false) {"),
        ("} else if (idle_stands(inputs)) {", "} else if (false) {"),
        ("terrapin_latch(state, TERRAPIN_LINK_STOPPED);", ""),
    )),
    Proof("dispatch", 10, "link/dispatch.c", (
        ("if (arm && (terrapin_bridge_on(state) || (stopped != 0U))) {", "if (arm && (stopped != 0U)) {"),
        ("(terrapin_bridge_on(state) || (stopped != 0U))", "terrapin_bridge_on(state)"),
        ("terrapin_latch(state, link->latched | stopped);", "terrapin_latch(state, link->latched);"),
        ("const uint32_t stopped = clears ? 0U :", "const uint32_t stopped = inputs->command_fresh ? 0U :"),
        ("(link->reply_counter < TERRAPIN_E2E_COUNTER_MAX) ?", "(link->reply_counter <= TERRAPIN_E2E_COUNTER_MAX) ?"),
    )),
    Proof("seal", 10, "link/seal.c", (
        ("(age > (LATE + EARLY)) || ", ""),
        ("(sent < next) || ", ""),
        (" + EARLY;", " + 2U * EARLY;"),
        ("(sent >= LASTING)", "(sent > LASTING)"),
    )),
    Proof("service", 10, "link/service.c", (
        ("i < service->outputs.frame_count;", "i <= service->outputs.frame_count;"),
    )),
    Proof("update", 10, "boot/update.c", (
        (" || (size == 0U)", ""),
        ("update->filled < TERRAPIN_UPDATE_BLOCK", "update->filled <= TERRAPIN_UPDATE_BLOCK"),
        ("} else if ((size > TERRAPIN_LAYOUT_SLOT_SIZE) ||", "} else if ("),
        ("} else if (!update_writable(update, &record, slot)) {", "} else if (false) {"),
        ("result = announced(update, &record);", "result = OK;"),
        ("if ((result == OK) && (record->revoked == (key + 1U))) {", "if (false) {"),
        ("const bool verified = update->ended &&", "const bool verified = update->ended ||"),
    )),
    Proof("store", 100, "store/parameters.c", (
        ("if ((guess < PARAMETERS) && (", "if (("),
        ("(room >= set_size(PARAMETERS))", "(room > UNIT)"),
        ("store->target = (stored && (store->active == 0U)) ? 1U : 0U;", "store->target = 0U;"),
    ), ("--unwindset", "scan.0:5,whole.0:50,load.0:4,is_erased.0:17,put_word.0:5,make_unit.0:17,make_unit.1:3",
        "--object-bits", "12")),
    Proof("records", 40, "boot/records.c", (
        ("(record->candidate <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&\n           (record->phase", "(record->phase"),
        ("i < TERRAPIN_RECORD_SIZE; i++) {\n        all", "i <= TERRAPIN_RECORD_SIZE; i++) {\n        all"),
    )),
    Proof("image", 12, "boot/image.c", (
        ("good = good && (length <= (size - place - TLV_HEAD));", ""),
    )),
    Proof("heading", 9, "core/heading.c", (
        ("return integer_clamp(from_um + integer_of_sine(way_um, share_q15), -FARTHEST_UM, FARTHEST_UM);",
         "return from_um + integer_of_sine(way_um, share_q15);"),
    )),
    Proof("drive", 9, "core/drive.c", (
        ("(supply >= SUPPLY_MIN_MV) ? integer_ratio(voltage_mv * DUTY_ONE, supply) : 0",
         "integer_ratio(voltage_mv * DUTY_ONE, supply)"),
        ("    d->enable = false;\n", ""),
    )),
    Proof("extrication", 9, "core/extrication.c", (
        ("const int32_t back = -state->supervisor.direction;", "const int32_t back = state->sense.motor_step;"),
    )),
    Proof("slip", 9, "core/slip.c", (
        ("(integer_abs(slip->shell_urad_s) >= state->rates.dead_urad_s)", "(slip->shell_urad_s > -1)"),
        ("(slip->newest + 1U) & (FAST_TICKS - 1U)", "slip->newest + 1U"),
        ("(slip->ticks < FAST_TICKS)", "(slip->ticks <= FAST_TICKS)"),
    ), alone=("counted", "slip_of")),
    Proof("sense", 9, "core/sense.c", (
        ("integer_clamp(mc, -HELD_MC, HELD_MC) * 256", "mc * 256"),
        ("sense->trimmed ? off_q8 : 0", "off_q8"),
    ), alone=("lasting",)),
    Proof("estimator", 9, "core/estimator.c", (
        ("(e->newest < (HISTORY_SLOTS - 1))", "(e->newest < HISTORY_SLOTS)"),
        ("e->full = e->slots > ((2U * n) + (uint32_t)BLOCK_SLOTS);", "e->full = e->slots > (2U * n);"),
        ("e->motor_unm = integer_hold(estimator_geared(&state->gains, drawn, e->counts) - beyond);",
         "e->motor_unm = drawn - beyond - e->friction_unm;"),
    )),
    Proof("friction", 9, "core/compensation.c", (
        ("if (urad < 450000) {", "if (urad > 450000) {"),
        ("integer_abs(omega) / 1000;", "omega / 1000;"),
    )),
    Proof("calibration", 9, "core/calibration.c", (
        ("    restart_step(c);\n}\n\n/* Largest", "}\n\n/* Largest"),
        ("integer_clamp(direction(state) * e->omega_urad_s, 0, OMEGA_MAX_URAD_S)", "e->omega_urad_s"),
    )),
    Proof("ground", 9, "core/ground.c", (
        ("integer_clamp(integer_cosine(turn), 8192, 32767)", "integer_cosine(turn)"),
        ("integer_clamp(sd_ppm, 1, Y_MAX)", "sd_ppm"),
    )),
    Proof("telemetry", 10, "core/telemetry.c", (
        ("state->counter < TERRAPIN_E2E_COUNTER_MAX", "state->counter <= TERRAPIN_E2E_COUNTER_MAX"),
    )),
    Proof("gains", 9, "core/gains.c", (
        ("integer_clamp(p[TERRAPIN_PARAMETER_DRIVE_RADIUS], 1, radius)", "p[TERRAPIN_PARAMETER_DRIVE_RADIUS] - radius"),
    )),
    Proof("step", 100, "core/step.c", (
        ("schedule_work(state, inputs);\n", "schedule_work(state, inputs);\n    outputs->enable = true;\n"),
    ), alone=("clear",)),
    Proof("clear", 250, "core/step.c", (
        ("(uint32_t)STATE_WORDS - 8U", "(uint32_t)STATE_WORDS - 7U"),
        ("    clear_four(&word[last + 4U]);", ""),
        ("i < last; i += 8U", "i < last; i += 9U"),
    )),
    Proof("integer", 3, "core/integer.c", (
        ("if (held > high) {", "if (held > low) {"),
    )),
)  # fmt: skip


def ranges() -> str:
    """A macro for the harnesses: every parameter of a state is within its range, whatever the board's ceilings."""
    source = ROOT / "firmware/terrapin_interface/controller.toml"
    given = tomllib.loads(source.read_text(encoding="utf-8"))["parameter"]
    held = (
        f"ASSUME((state).parameter[{p.index}] >= {given[p.name]['min']}); "
        f"ASSUME((state).parameter[{p.index}] <= {given[p.name]['max']})"
        for p in interface().parameters.values()
    )
    return "#define PARAMETERS_HOLD(state) do { " + "; ".join(held) + "; } while (0)\n"


def prover() -> list[str] | None:
    """The command that runs CBMC; None when it cannot be had."""
    done = subprocess.run(
        [str(ROOT / "tests" / "setup" / "cbmc.sh")], capture_output=True, text=True, check=False, timeout=900
    )
    return done.stdout.split() if done.returncode == 0 and done.stdout.strip() else None


def alarms(cbmc: list[str], proof: Proof, source: str | None = None) -> tuple[list[str], int]:
    """What CBMC cannot show, and how many properties it looked at. `source`: in place of the proof's own.

    TimeoutError after SECONDS; ValueError when the harness cannot be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "ranges.h").write_text(ranges(), encoding="utf-8")
        include = [folder, str(HERE), *(str(ROOT / "firmware" / p) for p in ("core", "link", "store", "boot"))]
        include += [str(ROOT / "firmware"), str(paths.build() / "generated")]
        if source is None and proof.alone:
            source = (ROOT / "firmware" / proof.source).read_text(encoding="utf-8")
        if source is not None:
            for function in proof.alone:
                source, found = re.subn(rf"^(static [\w ]+){function}\(", rf"\1{function}_itself(", source, flags=re.M)
                if found != 1:
                    raise ValueError(f"{proof.source}: found {found} static functions {function}, expected one")
            for name in (proof.source, Path(proof.source).name):  # as a harness may spell it
                (Path(folder) / name).parent.mkdir(exist_ok=True)
                (Path(folder) / name).write_text(source, encoding="utf-8")
        command = [*cbmc, str(HERE / f"prove_{proof.name}.c"), *CHECKS, "--c11", "--unwind", str(proof.turns)]
        command += proof.options
        limited = ["sh", "-c", f'ulimit -t {SECONDS:.0f}; exec "$@"', "proof", *command]
        done = subprocess.run(
            [*limited, *(word for place in include for word in ("-I", place))],
            cwd=ROOT, capture_output=True, text=True, check=False, timeout=10 * SECONDS,
        )  # fmt: skip
    lines = done.stdout.splitlines()
    if done.returncode not in (0, 10):
        if done.returncode < 0 or done.returncode > 128:
            raise TimeoutError(f"no answer in {SECONDS:g} s")
        raise ValueError((done.stderr.strip() or done.stdout.strip()).splitlines()[-1])
    return [line for line in lines if line.endswith(": FAILURE")], sum(": SUCCESS" in line for line in lines)


def shown(cbmc: list[str], proof: Proof) -> bool:
    """Run one proof and say what came of it."""
    begin = time.monotonic()
    try:
        failing, good = alarms(cbmc, proof)
    except (TimeoutError, ValueError) as error:
        print(f"{proof.name}: not shown: {error}")
        return False
    print(f"{proof.name}: {good} properties shown, {len(failing)} alarms, {time.monotonic() - begin:.1f} s", flush=True)
    for line in failing:
        print(f"  {line}")
    return not failing and good > 0


def noticed(cbmc: list[str], proof: Proof) -> bool:
    """Run one proof on each of its defects: true when all raise an alarm."""
    text = (ROOT / "firmware" / proof.source).read_text(encoding="utf-8")
    good = True
    for right, wrong in proof.defects:
        if right not in text:
            print(f"{proof.name}: {proof.source} no longer has {right!r}: plant another defect")
            good = False
            continue
        failing, _ = alarms(cbmc, proof, text.replace(right, wrong, 1))
        print(f"{proof.name}: {'alarm' if failing else 'NOT SEEN'}: {' '.join((wrong or 'without ' + right).split())}")
        good &= bool(failing)
    return good


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.proof", description="Proofs of the firmware.")
    parser.add_argument("--planted", action="store_true", help="defects, each of which must raise an alarm")
    parser.add_argument("name", nargs="*", choices=[[], *(p.name for p in PROOFS), "arithmetic"])
    options = parser.parse_args()
    passed, missing = True, []
    chosen = [proof for proof in PROOFS if not options.name or proof.name in options.name]
    cbmc = prover() if chosen else None
    if chosen and cbmc is None:
        missing.append(f"{', '.join(proof.name for proof in chosen)} (CBMC cannot be had: tests/setup/cbmc.sh)")
    for proof in chosen if cbmc is not None else []:
        passed &= (noticed if options.planted else shown)(cbmc or [], proof)
    if not options.name or "arithmetic" in options.name:
        if importlib.util.find_spec("z3") is None:
            missing.append("arithmetic (z3 not installed: pip install -r tests/proof/requirements.txt)")
        else:
            from tests.proof import arithmetic

            passed &= arithmetic.planted() if options.planted else arithmetic.shown()
    print("not run here: " + ("; ".join(missing) or "nothing, all of it ran"))
    return 0 if passed and not missing else 1


if __name__ == "__main__":
    sys.exit(main())
