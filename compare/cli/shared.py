"""What the commands share: options and their types, the scene, the folder, and what is printed."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from datetime import datetime
from decimal import Decimal, InvalidOperation
from functools import partial, reduce, wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rattle.compare.cli.ranges import RangeType
from rattle.compare.report.folder import check_free, default_place, name_of, report_files
from rattle.compare.report.interrupt import stored
from rattle.compare.report.json_text import Facts, json_text
from rattle.scene import DAT21, Scene, choice, compile_ahead, harmless
from rattle.scene.progress import ESTIMATES, apart_from_bars, do, print_on_stderr

if TYPE_CHECKING:
    from rattle.compare.report.report import Report

FILE_PATH = click.Path(path_type=Path)
Option = Callable[[Any], Any]
Begin = Callable[[], "Results"]  # checks the folder of the results, and starts the clock

SCHEME_NAMES = ("euler-maruyama", "euler-maruyama-located", "exact-flight")
CLOSURE_NAMES = ("published", "corrected", "saltation", "branching")
AXIS_NAMES = ("beta", "gap", "sigma", "epsilon")
# Written out, for --help does not wait for the modules that define them; a test compares them.
EXIT_NOT_MET = 3  # the accuracy, the width or the requirement that was asked for
SWEEP_POINTS = 100  # values of a sweep of exponents, where a range does not say how many
PAPER_SIGMA = 1.5**0.5  # sqrt(alpha) of DAT21

MOST_DIGITS = 60
LONGEST_NOTICE = 100  # characters of what a command says that it does


class WholeNumber(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """A whole number, also written as 1e5 or 100_000."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a whole number."""
        if isinstance(value, int):
            return value
        text = str(value).strip()
        try:
            number = Decimal(text)
        except InvalidOperation:
            self.fail(
                f"{text!r} is not a whole number; write it as 100000, 100_000 or 1e5", param, ctx
            )
        if (
            not number.is_finite()
            or number.adjusted() > MOST_DIGITS
            or number != number.to_integral_value()
        ):
            self.fail(f"{text!r} is not a whole number of at most {MOST_DIGITS} digits", param, ctx)
        return int(number)


WHOLE = WholeNumber()
"""The type of every option that takes a whole number."""


class Name(click.Choice):  # type: ignore[type-arg]  # generic only since click 8.2
    """A name from a list, which ``--help`` shows and the shell completes."""

    def __init__(self, field: str, names: Sequence[str]) -> None:
        super().__init__(names)
        self.field = field

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check a name."""
        return choice(self.field, value, self.choices)


SCENE_ARGUMENT = click.argument("scene", required=False, type=FILE_PATH)
OVERWRITE = click.option(
    "--overwrite", is_flag=True, help="Replace earlier results in that folder."
)


def whole(name: str, default: int | None, meaning: str) -> Option:
    """An option that takes a whole number."""
    return click.option(f"--{name}", type=WHOLE, default=default, help=meaning)


def real(name: str, meaning: str, default: float | None = None) -> Option:
    """An option that takes a number."""
    return click.option(f"--{name}", type=float, default=default, help=meaning)


class ClosureName(Name):
    """The name of a closure, or ``package.module:function`` of one's own."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check a name; a function is imported later."""
        return (
            value if isinstance(value, str) and ":" in value else super().convert(value, param, ctx)
        )


CLOSURE_TYPE = ClosureName("closures", CLOSURE_NAMES)
SCHEME_TYPE = Name("scheme", SCHEME_NAMES)
AXIS_TYPE = Name("axis", AXIS_NAMES)


def several(option: str, into: str, kind: Any, meaning: str) -> Option:
    """An option that may be given any number of times."""
    metavar = "NAME" if kind is str else None
    return click.option(
        f"--{option}", into, multiple=True, type=kind, metavar=metavar, help=meaning
    )


def over(meaning: str, default: str | None = None, only: str = "", option: str = "over") -> Option:
    """An option that takes the range of a parameter."""
    into = "along" if option == "and" else option
    spelling = f"{only or 'NAME'}=LOW:HIGH[:POINTS]"
    kind = RangeType(only)
    shown = "[default: " not in meaning
    return click.option(
        *(f"--{option}", into),
        type=kind,
        default=default,
        metavar=spelling,
        help=meaning,
        show_default=shown,
    )


def closures(meaning: str) -> Option:
    """The option of the closures that are compared."""
    return several("closure", "closures", CLOSURE_TYPE, meaning)


def name_option(
    option: str, names: Sequence[str], meaning: str, default: str | None = None
) -> Option:
    """An option that takes a name from a list."""
    return click.option(f"--{option}", type=Name(option, names), default=default, help=meaning)


def join(*options: Option) -> Option:
    """Several options as one."""
    return lambda command: reduce(lambda inner, option: option(inner), reversed(options), command)


SIGMA_OPTION = real("sigma", "Noise intensity. [default: the scene's; sqrt(alpha) on DAT21]")
SCENE_AND_SIGMA = join(SCENE_ARGUMENT, SIGMA_OPTION)
SEED_OPTION = whole("seed", 0, "Seed.")
WORKERS = whole("workers", 2, "Threads; the result does not depend on it.")
SEED_AND_WORKERS = join(SEED_OPTION, WORKERS)


def check_scheduler(ctx: click.Context, param: click.Parameter, address: str | None) -> str | None:
    """Check the address of a scheduler, and keep Dask's own messages off the terminal."""
    if address is not None:
        from rattle.compare.engine.cluster import check_address, silence

        check_address(address)
        silence()
    return address


SCHEDULER = click.option(
    "--scheduler",
    callback=check_scheduler,
    metavar="tcp://HOST:PORT",
    help=(
        "Compute on a running Dask cluster instead. A Dask scheduler has no authentication and runs"
        " what it is sent: use one in a trusted network only, or tls://HOST:PORT with the"
        " certificates that Dask's configuration names."
    ),
)


def folder(default: Path | str) -> Option:
    """The option of the folder of the results: a path, or in words which one is taken if none is
    given."""
    given = isinstance(default, Path)
    words = "Folder." if given else f"Folder. [default: {default}]"
    return click.option("--out", type=FILE_PATH, default=default if given else None, help=words)


def json_flag(what: str) -> Option:
    """The flag that prints something as JSON."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print {what} as JSON.")


def folder_options(default: Path | str, *more: Option) -> Option:
    """The options of the folder of the results, and of what is printed in place of it."""
    return join(folder(default), OVERWRITE, *more)


JSON_ALONE = click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print everything as JSON; no folder is written without --out.",
)


WRITTEN = ("out", "overwrite", "as_json")
"""Options of what is written, which `Results` gets."""


def name_scene(path: Path | None) -> str:
    """The name of a scene by its file; DAT21 without one."""
    return name_of(path) if path else "DAT21"


def report(default: str, module: str, *more: Option, otherwise: float = PAPER_SIGMA) -> Option:
    """The options of the folder of a command on a scene, which gets the loaded scene, and a
    function for its `Results`.

    `default`: Ends in the name of the page. `module`: Module within `rattle.compare` with its
    function ``make_report``. `otherwise`: Noise intensity of DAT21, if no scene is given.
    """

    def decorate(command: Callable[..., None]) -> Any:
        @wraps(command)
        def run(scene: Path | None, sigma: float | None, **asked: Any) -> None:
            written = {name: asked.pop(name) for name in WRITTEN if name in asked}
            page = default.removeprefix("reports/NAME-")
            base = load_scene(scene, sigma, otherwise)
            name = name_scene(scene)
            command(
                base,
                partial(Results, name, page=page, module=module, scene=base, **written),
                **asked,
            )

        return folder_options(default, *more)(run)

    return decorate


class CommandGroup(click.Group):
    """Group of commands, each of which states what it does before it begins."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that is asked for."""
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            do(f"{name} ({command.get_short_help_str(LONGEST_NOTICE).rstrip('.')})")
        return name, command, rest


class Results:
    """The folder of a command's results, and what their manifest says of the run; ``--json`` alone
    writes none."""

    def __init__(
        self,
        name: str,
        out: Path | None,
        page: str,
        module: str,
        overwrite: bool,
        as_json: bool = False,
        scene: Scene | None = None,
    ) -> None:
        from rattle.compare.engine.run import check_cells
        from rattle.compare.report.provenance import Stopwatch

        self.about: Facts = {"name": name} if name else {}
        if scene:
            self.about["scene"] = scene.to_dict()
        self.overwrite = overwrite
        self.as_json = as_json
        self.writes = out is not None or not as_json
        self.page = page
        self.out = out or default_place(name, f"-{page}")
        if self.writes:
            self.make_report = import_module(f"rattle.compare.{module}").make_report
            check_free(self.out, report_files(page), overwrite)
            if self.cells:
                check_cells(self.cells)
            stored.append(self._describe_stored)
        self.watch = Stopwatch()

    @property
    def cells(self) -> Path | None:
        """Where the command keeps its cells: beside the folder, which is replaced as a whole."""
        return self.out.with_name(f"{self.out.name}-cells") if self.writes else None

    def write(self, *found: Any, **settings: Any) -> Sequence[str]:
        """Write the folder, with the settings in its manifest; the answer of its page."""
        from rattle.compare.report.provenance import provenance
        from rattle.compare.report.save import save

        if not self.writes:
            return ()
        record = self.about | settings | provenance(self.watch)
        report: Report = self.make_report(*found, record)
        save(self.out, report, self.overwrite)
        stored.append(lambda: f"the page is written: {self.out}")
        return report.answer

    def conclude(self, found: Any, **settings: Any) -> None:
        """Write the folder, and print the answer."""
        self.write(found, **settings)
        self.say(found.answer, found.to_dict)

    def _describe_stored(self) -> str:
        """What an interrupt leaves."""
        cells = self.cells
        number = sum(1 for _ in cells.rglob("*.parquet")) if cells else 0
        if not number:
            return "nothing was written"
        return f"{number} results stored in {cells}; run the same command again to continue"

    def say(self, sentences: Iterable[str], data: Callable[[], Facts] = dict) -> None:
        """Print the answer and the place of the page, or the data as JSON."""
        if self.as_json:
            say_json(data() | {"report": self.out if self.writes else None})
        else:
            say_lines((*sentences, f"Page: {self.out / self.page}.html"))


def say(text: str, *, err: bool = False, keep: str = "") -> None:
    """Print a text on one line; control characters, such as those of a file's name, are shown as
    escapes."""
    # nobody may read what is said besides
    with suppress(OSError) if err else nullcontext(), apart_from_bars():
        click.echo(harmless(text, keep), err=err)


def say_lines(sentences: Iterable[str]) -> None:
    """Print texts, each on a line of its own."""
    for sentence in sentences:
        say(sentence)


def say_json(data: Any) -> None:
    """Print data as strict JSON; NaN and infinities become null."""
    with apart_from_bars():
        click.echo(json_text(data))


def say_part(part: str) -> None:
    """Print on standard error which part of a long command begins, and when."""
    say(f"{datetime.now():%H:%M:%S} {part}", err=True)
    do(part)


class Printer(logging.Handler):
    """Prints what is logged on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        print_on_stderr(record.getMessage())


@contextmanager
def estimates_shown() -> Iterator[None]:
    """Context in which estimates of the time that work takes are printed."""
    printer = Printer()
    level = ESTIMATES.level
    ESTIMATES.addHandler(printer)
    ESTIMATES.setLevel(logging.INFO)
    try:
        yield
    finally:
        ESTIMATES.removeHandler(printer)
        ESTIMATES.setLevel(level)


def pick(settings: Mapping[str, Any], *names: str) -> Facts:
    """Some of the settings."""
    return {name: settings[name] for name in names}


def load_scene(path: Path | None, sigma: float | None, otherwise: float = PAPER_SIGMA) -> Scene:
    """Load a scene file, or DAT21 at the noise intensity `otherwise`; `sigma` replaces either's
    noise."""
    scene = Scene.load(path) if path else Scene.from_gears(DAT21, sigma=otherwise)
    compile_ahead.expect(str(click.get_current_context().info_name), len(scene.drive))
    if sigma is not None:
        return scene.with_sigma(sigma)
    if path and scene.sigma == 0.0:
        say(f"{path}: no sigma, so there is no noise", err=True)
    return scene
