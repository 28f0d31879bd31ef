"""`make mutants`: plant single faults in the code that scores rest on, and count how many the tests notice.

Cosmic Ray makes the mutants. This script draws a seeded sample over the areas below, runs on each mutant the
tests that reach it, in a copy of the checkout, and prints the share that was killed and every survivor with
its change. docs/mutants.md holds the last result and a reason for each survivor.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import json
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import parso
from cosmic_ray.ast import ast_nodes
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from coverage import CoverageData
from parso.tree import NodeOrLeaf

ROOT = Path(__file__).resolve().parents[1]
SERVER = Path(__file__).with_name("mutant_server.py")

# Files to mutate, and the tests that must notice. An area gets its share of the sample by its number of
# mutable places.
AREAS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "scoring": (("bench/scoring/*.py",), ("tests/scoring",)),
    "statistics": (("bench/statistics/*.py",), ("tests/statistics", "tests/scoring")),
    "journal and runner": (
        ("bench/campaign/_runner.py", "bench/campaign/storage/*.py", "bench/campaign/execution/_[bd]*.py"),
        ("tests/campaign",),
    ),
    "failsafes and fence": (
        ("vehicle_models/controller/safety/*.py",),
        tuple(
            f"tests/vehicle_models/test_vehicle_{name}.py"
            for name in ("failsafes", "fence", "failures", "health", "effects")
        ),
    ),
    "measures": (("test_ports/**/*.py",), ("tests/test_ports",)),
    "placement judge": (("bench/realization/placement/_check.py",), ("tests/realization",)),
}

# Cosmic Ray also turns `+` into `<<` or `<` into `is`: such mutants raise at once, and killing them proves
# nothing.
OPERATORS = (
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_BitAnd_BitOr",
    "ReplaceBinaryOperator_BitOr_BitAnd",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_USub",
    "NumberReplacer",
    "AddNot",
    "ZeroIterationForLoop",
)
COMPARISONS = ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE")

# The tests of a mutant may take this many times as long as those of the sound code, so that a busy host kills
# nothing.
TIMEOUT_FACTOR = 3.0
LEAST_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change at one place of one file."""

    area: str
    path: str
    operator: str
    occurrence: int
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the tests did: `killed`, `timeout` (also a kill) or `survived` (all tests of the area pass)."""

    mutant: Mutant
    outcome: str
    before: str
    after: str
    seconds: float


def operators() -> list[str]:
    """Full names of the operators used."""
    wanted = {
        *OPERATORS,
        *(f"ReplaceComparisonOperator_{a}_{b}" for a in COMPARISONS for b in COMPARISONS if a != b),
    }
    return sorted(name for name in operator_names() if name.rpartition("/")[2] in wanted)


def annotation_spans(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Begin and end (line, column) of every annotation: under `from __future__ import annotations` they are
    not evaluated.
    """
    spans = []
    for node in ast.walk(ast.parse(source)):
        for annotation in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            if isinstance(annotation, ast.expr):
                begin = (annotation.lineno, annotation.col_offset)
                end = (annotation.end_lineno or annotation.lineno, annotation.end_col_offset or 0)
                spans.append((begin, end))
    return spans


def is_separator(node: NodeOrLeaf) -> bool:
    """Whether a node is the `*` or `/` between parameters, which Cosmic Ray takes for an operator."""
    return node.parent is not None and node.parent.type in ("parameters", "param", "lambdef")


def mutants_of(area: str, path: str, names: Sequence[str]) -> Iterator[Mutant]:
    """Every mutant of a file, in the order of operators and places."""
    source = (ROOT / path).read_text(encoding="utf-8")
    spans = annotation_spans(source)
    tree = parso.parse(source)
    for name in names:
        operator = get_operator(name)()
        occurrence = 0
        for node in ast_nodes(tree):
            for begin, _ in operator.mutation_positions(node):
                if not is_separator(node) and not any(low <= begin < high for low, high in spans):
                    yield Mutant(area, path, name, occurrence, *begin)
                occurrence += 1


def drawn(count: int, seed: int) -> list[Mutant]:
    """The sample over all areas: they weigh by their number of places, and every place is drawn at most once,
    with one of its changes.
    """
    generator = random.Random(seed)
    names = operators()
    places: dict[str, dict[tuple[str, int, int], list[Mutant]]] = {}
    for area, (patterns, _) in AREAS.items():
        files = sorted({path for pattern in patterns for path in ROOT.glob(pattern)})
        found: dict[tuple[str, int, int], list[Mutant]] = {}
        for path in files:
            for mutant in mutants_of(area, str(path.relative_to(ROOT)), names):
                found.setdefault((mutant.path, mutant.line, mutant.column), []).append(mutant)
        places[area] = found
    every_place = [(area, place) for area in places for place in sorted(places[area])]
    sample = generator.sample(every_place, min(count, len(every_place)))
    return [generator.choice(places[area][place]) for area, place in sample]


def copy_of_checkout(folder: Path) -> Path:
    """The files that git knows or would add, in a folder of their own: the working tree itself is never
    touched.
    """
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(listing, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in names.split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def put(path: Path, source: str) -> None:
    """Replace a module, and remove its bytecode: Python knows stale bytecode by the second and the size of the
    source, which is too coarse for the change of a digit.
    """
    path.write_text(source, encoding="utf-8")
    Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)


class SoundCodeFails(Exception):
    """The tests of an area fail on the sound code, so that nothing can be measured."""


# Without the tests that `make test` leaves out or that take minutes.
PYTEST_ARGUMENTS = ("-q", "-p", "no:cacheprovider", "-m", "not clients and not slow and not real")


def environment_of(folder: Path) -> dict[str, str]:
    """This environment, with the modules of a copy, whose bytecode is kept."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return environment


def run_tests(folder: Path, tests: Sequence[str], timeout_s: float) -> str:
    """`survived` when all tests pass, `killed` when one fails, `timeout` when they take too long."""
    # A session of its own, so that a mutant that loops is ended with everything that it started.
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *PYTEST_ARGUMENTS, "-x", *tests],
        cwd=folder,
        env=environment_of(folder),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return "survived" if process.wait(timeout_s) == 0 else "killed"
    except subprocess.TimeoutExpired:
        return "timeout"
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


class Forks:
    """One mutant_server for each area, in one copy of the checkout, started when it is first needed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._servers: dict[str, subprocess.Popen[str]] = {}

    def run_tests(self, mutant: Mutant, sound: str, tests: Sequence[str], timeout_s: float) -> str:
        """As the function of this name, or `fresh` where only a fresh interpreter can tell."""
        server = self._servers.get(mutant.area)
        if server is None:
            server = self._servers[mutant.area] = subprocess.Popen(
                [sys.executable, SERVER, *PYTEST_ARGUMENTS, *AREAS[mutant.area][1]],
                cwd=self._folder,
                env=environment_of(self._folder),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        assert server.stdin
        assert server.stdout
        order = {
            "path": str(self._folder / mutant.path),
            "sound": sound,
            "tests": tests,
            "timeout_s": timeout_s,
        }
        server.stdin.write(json.dumps(order) + "\n")
        server.stdin.flush()
        answer = server.stdout.readline().strip()
        if not answer:
            raise SoundCodeFails(f"the tests of {mutant.area} cannot be collected")
        return answer

    def close(self) -> None:
        for server in self._servers.values():
            server.communicate()


@dataclass(frozen=True, slots=True)
class Reach:
    """Which tests execute which lines of an area's files, and how long all of them take."""

    by_line: Mapping[tuple[str, int], frozenset[str]]
    tests: frozenset[str]
    seconds: float

    @property
    def timeout_s(self) -> float:
        return LEAST_TIMEOUT_S + TIMEOUT_FACTOR * self.seconds

    def of(self, mutant: Mutant) -> frozenset[str]:
        """The tests that execute the line; all of the area for lines that only an import or a child process
        executes, which are in no report.
        """
        return self.by_line.get((mutant.path, mutant.line)) or self.tests

    def write(self, file: Path) -> None:
        names = sorted(self.tests)
        number = {name: index for index, name in enumerate(names)}
        lines = [
            [path, line, sorted(number[test] for test in tests)]
            for (path, line), tests in self.by_line.items()
        ]
        file.write_text(
            json.dumps({"tests": names, "lines": lines, "seconds": self.seconds}), encoding="utf-8"
        )

    @classmethod
    def read(cls, file: Path) -> Reach:
        document = json.loads(file.read_text(encoding="utf-8"))
        names = document["tests"]
        by_line = {
            (path, line): frozenset(names[number] for number in numbers)
            for path, line, numbers in document["lines"]
        }
        return cls(by_line, frozenset(names), document["seconds"])


def reach_of(folder: Path, area: str) -> Reach:
    """Run the tests of an area on the sound code, with coverage by test.

    Raises SoundCodeFails when one fails.
    """
    began = time.monotonic()
    patterns, tests = AREAS[area]
    data_file = folder / f".coverage-{area.replace(' ', '-')}"
    files = sorted({str(path.relative_to(ROOT)) for pattern in patterns for path in ROOT.glob(pattern)})
    rooms = sorted({str(Path(name).parent) for name in files})
    command = [
        *(sys.executable, "-m", "pytest", *PYTEST_ARGUMENTS, "--cov-context=test", "--cov-report="),
        *(f"--cov={room}" for room in rooms),
        *tests,
    ]
    environment = environment_of(folder) | {"COVERAGE_FILE": str(data_file)}
    if subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL).returncode:
        raise SoundCodeFails(f"the tests of {area} fail without any mutant: {' '.join(tests)}")
    seconds = time.monotonic() - began
    data = CoverageData(str(data_file))
    data.read()
    every_test = frozenset(test for test, _, _ in map(_context, data.measured_contexts()) if test)
    by_line: dict[tuple[str, int], frozenset[str]] = {}
    for name in files:
        for line, contexts in data.contexts_by_lineno(str(folder / name)).items():
            executing = [context for context in map(_context, contexts) if context[0]]
            # A fixture of a module runs once, in the set-up of the first test that wants it, and the other
            # tests of the module read what it left.
            modules = {test.partition("::")[0] for test, _, phase in executing if phase == "setup"}
            shared = {test for test in every_test if test.partition("::")[0] in modules}
            by_line[name, line] = frozenset({test for test, _, _ in executing} | shared)
    return Reach(by_line, every_test, seconds)


def _context(name: str) -> tuple[str, str, str]:
    """Test and phase of a context of pytest-cov, with the bar between them."""
    test, bar, phase = name.rpartition("|")
    return test, bar, phase


def try_mutant(
    folder: Path, mutant: Mutant, tests: frozenset[str], timeout_s: float, forks: Forks | None = None
) -> Verdict:
    """Plant the fault, run the tests, put the file back; in a fork where that is given and can tell."""
    path = folder / mutant.path
    source = path.read_text(encoding="utf-8")
    changed = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
    if changed is None:
        raise AssertionError(f"{mutant} changes nothing")
    began = time.monotonic()
    names = sorted(tests)
    try:
        put(path, changed)
        outcome = forks.run_tests(mutant, source, names, timeout_s) if forks else "fresh"
        if outcome == "fresh":
            outcome = run_tests(folder, names, timeout_s)
    finally:
        put(path, source)
    pairs = zip(source.splitlines(), changed.splitlines(), strict=False)
    before, after = next(((a.strip(), b.strip()) for a, b in pairs if a != b), ("", ""))
    return Verdict(mutant, outcome, before, after, time.monotonic() - began)


Item = TypeVar("Item")


def in_parallel(work: Callable[[Path, Item], None], items: Iterable[Item], folders: Sequence[Path]) -> None:
    """Call `work` for every item, with one thread for each folder. The first exception ends all."""
    todo: queue.SimpleQueue[Item] = queue.SimpleQueue()
    for item in items:
        todo.put(item)

    def worker(folder: Path) -> None:
        while True:
            try:
                item = todo.get_nowait()
            except queue.Empty:
                return
            try:
                work(folder, item)
            except BaseException:
                while not todo.empty():
                    todo.get_nowait()
                raise

    with ThreadPoolExecutor(len(folders)) as pool:
        for future in [pool.submit(worker, folder) for folder in folders]:
            future.result()


def run_sample(
    sample: Sequence[Mutant], earlier: Sequence[Verdict], workers: int, results: Path, *, resume: bool
) -> list[Verdict]:
    """Try every mutant without a verdict, `workers` at a time, each worker in a copy of the checkout of its
    own.
    """
    verdicts = {verdict.mutant: verdict for verdict in earlier}
    todo = [mutant for mutant in sample if mutant not in verdicts]
    reaches: dict[str, Reach] = {}
    lock = threading.Lock()

    def find_reach(folder: Path, area: str) -> None:
        file = results.with_name(f"mutants-{area.replace(' ', '-')}.json")
        reaches[area] = reach = Reach.read(file) if resume and file.exists() else reach_of(folder, area)
        reach.write(file)
        # A name that pytest does not know would look like a kill.
        if run_tests(folder, ["--collect-only", *sorted(reach.tests)], LEAST_TIMEOUT_S) != "survived":
            raise SoundCodeFails(f"pytest does not know all tests of {area} by the names in {file}")
        print(f"{area}: the tests of the sound code pass in {reach.seconds:.0f} s", flush=True)

    def record(verdict: Verdict) -> None:
        mutant = verdict.mutant
        with lock:
            verdicts[mutant] = verdict
            print(
                f"{len(verdicts):4}/{len(sample)} {verdict.outcome:9} {verdict.seconds:4.0f} s "
                f"{mutant.path}:{mutant.line}  {verdict.after[:60]}",
                flush=True,
            )
            text = json.dumps([asdict(verdict) for verdict in verdicts.values()], indent=1)
            results.write_text(text, encoding="utf-8")

    def try_reached(folder: Path, mutant: Mutant) -> None:
        reach = reaches[mutant.area]
        record(try_mutant(folder, mutant, reach.of(mutant), reach.timeout_s, forks[folder]))

    def try_all(folder: Path, mutant: Mutant) -> None:
        reach = reaches[mutant.area]
        record(try_mutant(folder, mutant, reach.tests, reach.timeout_s))

    with tempfile.TemporaryDirectory(prefix="rebar-mutants-") as scratch:
        folders = [copy_of_checkout(Path(scratch, str(number))) for number in range(workers)]
        open_areas = dict.fromkeys(
            mutant.area
            for mutant in sample
            if mutant not in verdicts or verdicts[mutant].outcome == "survived"
        )
        in_parallel(find_reach, open_areas, folders)
        forks = {folder: Forks(folder) for folder in folders}
        try:
            in_parallel(try_reached, todo, folders)
        finally:
            for servers in forks.values():
                servers.close()
        # What a cache holds is computed in one test, or before the fork, and read in others. So survivors meet
        # all tests of their area in a fresh interpreter.
        survivors = [mutant for mutant in sample if verdicts[mutant].outcome == "survived"]
        in_parallel(try_all, survivors, folders)
    return list(verdicts.values())


def read_verdicts(results: Path) -> list[Verdict]:
    """The verdicts of an earlier run, none where there was no run."""
    if not results.exists():
        return []
    return [
        Verdict(**{**verdict, "mutant": Mutant(**verdict["mutant"])})
        for verdict in json.loads(results.read_text(encoding="utf-8"))
    ]


def main() -> int:
    """0 when the wanted share of the sample is killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="mutants to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--area", choices=AREAS, action="append", help="only the mutants of this area; may be repeated"
    )
    parser.add_argument("--at-least", type=float, default=0.85, help="share to be killed")
    parser.add_argument(
        "--results", type=Path, default=Path("out/mutants.json"), help="verdicts, written as they come"
    )
    parser.add_argument("--resume", action="store_true", help="keep the verdicts of the results file")
    parser.add_argument(
        "--survivors", action="store_true", help="keep the kills of the results file, try its survivors again"
    )
    arguments = parser.parse_args()
    arguments.results.parent.mkdir(parents=True, exist_ok=True)
    sample = [
        mutant
        for mutant in drawn(arguments.count, arguments.seed)
        if mutant.area in (arguments.area or AREAS)
    ]
    earlier = [
        verdict
        for verdict in (read_verdicts(arguments.results) if arguments.resume or arguments.survivors else [])
        if verdict.mutant in sample and not (arguments.survivors and verdict.outcome == "survived")
    ]
    try:
        verdicts = run_sample(sample, earlier, arguments.workers, arguments.results, resume=arguments.resume)
    except SoundCodeFails as failure:
        sys.exit(str(failure))
    print()
    for area in dict.fromkeys(mutant.area for mutant in sample):
        of_area = [verdict for verdict in verdicts if verdict.mutant.area == area]
        killed = sum(verdict.outcome != "survived" for verdict in of_area)
        print(f"{area:22} {killed:4} of {len(of_area):4} killed")
    survivors = [verdict for verdict in verdicts if verdict.outcome == "survived"]
    for verdict in sorted(survivors, key=lambda verdict: (verdict.mutant.path, verdict.mutant.line)):
        print(
            f"\nsurvived  {verdict.mutant.path}:{verdict.mutant.line}\n  - {verdict.before}\n  + {verdict.after}"
        )
    share = 1.0 - len(survivors) / len(verdicts)
    print(f"\n{100 * share:.1f} % of {len(verdicts)} killed")
    return 0 if share >= arguments.at_least else 1


if __name__ == "__main__":
    sys.exit(main())
