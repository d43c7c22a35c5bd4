"""The command line: help, usage, exit status, and processes of its own."""

import os
import re
import signal
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from are_ros import cli
from are_ros._version import __version__
from are_ros.bag.roles import ROLE_TYPES
from are_ros.cli import are, main
from are_ros.errors import BagError, NodeError, missing_packages

PROJECT = Path(__file__).resolve().parents[1]
SAMPLE = PROJECT / "bags" / "sample_office.mcap"
OFFLINE = ("replay", "inspect", "align", "describe", "check", "view", "export", "fit", "soak")
COMMANDS = (*OFFLINE, "node", "guard", "play", "record", "demo")


def run_process(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the installed `are` as a process of its own."""
    command = [str(Path(sys.executable).with_name("are")), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def end_of(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run `are` in this process, and return its exit status."""
    monkeypatch.setattr("sys.argv", ["are", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_reads_well(command: str | None) -> None:
    """Help has a sentence for the command and for each option, in lines of 100 columns."""
    words = ["--help"] if command is None else [command, "--help"]
    done = CliRunner().invoke(are, words, terminal_width=100)
    assert done.exit_code == 0
    assert all(len(line) <= 100 for line in done.output.splitlines())
    assert "Usage: are" in done.output
    assert not re.search(r"FLOAT|\d\.\d*<=x|x<=\d*\.", done.output)
    group_or_command = are if command is None else are.commands[command]
    assert group_or_command.help
    for parameter in group_or_command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, parameter.name
            assert parameter.opts[0] in done.output


def test_the_help_names_every_role_that_a_recording_has() -> None:
    """All but the clicks, which only a live node takes."""
    told = " ".join(CliRunner().invoke(are, ["replay", "--help"]).output.split())
    roles = told.partition("Let a topic play a part: ")[2].partition(". Repeatable")[0].split(", ")
    assert set(roles) == ROLE_TYPES.keys() - {"clicked_point"}


def test_every_command_is_listed() -> None:
    """The group lists the commands, each with a short sentence; bare `are` shows the same."""
    listed = CliRunner().invoke(are, ["--help"]).output
    assert tuple(sorted(COMMANDS)) == tuple(sorted(are.commands))
    assert all(are.commands[name].short_help for name in COMMANDS)
    bare = CliRunner().invoke(are, [])
    assert (bare.exit_code, bare.output) == (0, listed)


def test_version_is_the_package_s() -> None:
    """`are --version` says the one version."""
    done = run_process("--version")
    assert (done.returncode, done.stdout) == (0, f"are, version {__version__}\n")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("nix",), ("nix", "(see `are --help`)")),
        (("replay",), ("BAG...", "(see `are replay --help`)")),
        (("replay", "--nix", "a"), ("--nix", "(see `are replay --help`)")),
        (("check", "a", "b"), ("(b)", "(see `are check --help`)")),
        (("replay", "a.bag", "--seed", "-1"), ("'--seed': -1 is not in the range x>=0",)),
        (("replay", "a.bag", "--skip", "all"), ("'--skip'", "'grids'")),
        (("replay", "a.bag", "--seed", "x"), ("'--seed': 'x' is not a valid integer (see",)),
        (("replay", "a.bag", "--start", "nan"), ("'--start': 'nan' is not a number",)),
        (("replay", "a.bag", "--start", "-1"), ("'--start': -1 is less than 0",)),
        (("replay", "a.bag", "--duration", "inf"), ("'--duration': inf is more than 1e+09",)),
        (("replay", "a.bag", "--duration", "1e300"), ("'--duration': 1e300 is more than",)),
        (("replay", "a.bag", "--start", "1:30"), ("'--start': '1:30' is not a number",)),
        (
            ("replay", "a.bag", "--topic", "scan=/scan"),
            ("--topic", "'scan=/scan' must be ROLE"),
        ),
        (
            ("inspect", "a.bag", "--topic", "scan"),
            ("'scan' must be ROLE:=/TOPIC, as scan:=/f",),
        ),
        (("replay", "a.bag", "--set", "a=1"), ("'--set': 'a=1' must be NAME:=VALUE, as popul",)),
        (("replay", "a.bag", "--map", "a", "--map", "b"), ("--map can be given only once",)),
        (("describe", "--set", ":=1"), ("':=1' must be NAME:=VALUE",)),
        (("play",), ("BAG...", "(see `are play --help`)")),
        (("play", "a.bag", "--rate", "0"), ("'--rate': 0 is less than 0.001",)),
        (("play", "a.bag", "--clock", "1001"), ("'--clock': 1001 is more than 1000",)),
        (("play", "a.bag", "--duration", "nan"), ("'--duration': 'nan' is not a number",)),
        (("soak", "--map", "a.yaml", "--minutes", "0"), ("'--minutes': 0 is less than 0.001",)),
        (("play", "a.bag", "--lockstep", "a b"), ("'--lockstep': 'a b' is no name in ROS 2",)),
        (("play", "a.bag", "--wait-for", "/a//b"), ("'--wait-for': '/a//b' is no name",)),
        (("view", "--live", "--namespace", "/robots/1st"), ("'/robots/1st' is no name",)),
        (("node", "--namespace", "my robot"), ("'--namespace': 'my robot' is no name",)),
        (("guard", "--namespace", "my robot"), ("'--namespace': 'my robot' is no name",)),
        (("record", "a", "--wait-for", "/a b"), ("'--wait-for': '/a b' is no name in ROS",)),
        (("view", "out", "--port", "80"), ("--port and --namespace are for --live",)),
        (("record",), ("OUT", "(see `are record --help`)")),
        (("record", "a", "b"), ("(b)", "(see `are record --help`)")),
        (("demo", "--rate", "x"), ("'--rate'", "(see `are demo --help`)")),
        (("node", "--params"), ("Option '--params' requires an argument",)),
        (("node", "--set", "x"), ("'--set': 'x' must be NAME:=VALUE, as population.arrival",)),
    ],
)
def test_wrong_usage_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    parts: tuple[str, ...],
) -> None:
    """What the options do not allow is said in a line, with exit status 2."""
    assert end_of(monkeypatch, *words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("are: ")
    assert all(part in line for part in parts)


@pytest.mark.parametrize(
    ("raised", "status", "sentence"),
    [
        (BagError("the recording is gone"), 1, "are: the recording is gone\n"),
        (KeyboardInterrupt(), 130, "are: interrupted\n"),
        (None, 0, ""),
    ],
)
def test_errors_become_a_sentence_and_a_status(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    raised: BaseException | None,
    status: int,
    sentence: str,
) -> None:
    """An error of ours is said; an interruption, too; an end is an end."""

    def command(**_: object) -> None:
        if raised is not None:
            raise raised

    monkeypatch.setattr(cli, "are", command)
    assert end_of(monkeypatch) == status
    assert capsys.readouterr().err == sentence


def test_other_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake of the program itself keeps its traceback."""

    def command(**_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(cli, "are", command)
    with pytest.raises(ZeroDivisionError):
        main()


def test_describe_and_inspect_print(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both print to stdout, as text of moderate width."""
    for words in (("describe",), ("inspect", str(SAMPLE))):
        assert end_of(monkeypatch, *words) == 0
        said = capsys.readouterr()
        assert said.err == ""
        assert len(said.out.splitlines()) > 20
        assert all(len(line) <= 120 for line in said.out.splitlines())


def test_describe_knows_the_map_and_the_parameters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The free area of --map and the values of --params, --set and --seed enter."""
    (tmp_path / "m.pgm").write_bytes(b"P5 20 10 255\n" + bytes([254]) * 200)
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    (tmp_path / "p.yaml").write_text(
        "ar_builder:\n  ros__parameters:\n    population:\n"
        "      mean_life: 20.0\n      arrival_rate: 0.5\n"
    )
    words = ("--params", str(tmp_path / "p.yaml"), "--set", "population.arrival_rate:=0.01")
    map_words = ("--map", str(tmp_path / "m.yaml"), "--seed", "7")
    assert end_of(monkeypatch, "describe", *words, *map_words) == 0
    text = capsys.readouterr().out
    assert "50 m^2" in text
    assert "30 artefacts per minute" in text
    assert "mean 20 s" in text
    assert "seed 7" in text


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("inspect", "none.mcap"), 1),
        (("replay", SAMPLE, "--duration", 1, "--map-frame", "nonsense"), 1),
        (("replay", SAMPLE, "--seed", "x"), 2),
        (("check", "none"), 1),
    ],
)
def test_a_process_of_its_own_says_one_sentence(
    tmp_path: Path, words: tuple[object, ...], status: int
) -> None:
    """From a real shell: one line on stderr, no traceback, a status, nothing written."""
    out = ("--out", tmp_path / "out") if words[0] == "replay" else ()
    done = run_process(*words, *out)
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    assert sum(line.startswith("are: ") for line in done.stderr.splitlines()) == 1
    assert list(tmp_path.glob("out/*")) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("play", "none.mcap"), "none.mcap: there is no such file or folder"),
        (("play", SAMPLE, "--remap", "/scan"), "--remap /scan: it must be /FROM:=/TO"),
        (("play", SAMPLE, "--clock", 0, "--lockstep", "a"), "--lockstep needs /clock"),
        (("record", "none.db3"), "none.db3: a recording is an .mcap file"),
        (("record", SAMPLE), "exists already; choose another name, or --overwrite"),
        (("demo", "none.mcap"), "none.mcap: there is no such file or folder"),
    ],
)
def test_live_commands_say_one_sentence(
    ros_available: None, words: tuple[object, ...], sentence: str
) -> None:
    """Status 1, and one line on stderr: files that are not there, or are, and odd wishes."""
    del ros_available
    done = run_process(*words)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("are: ")
    assert sentence in line


def test_live_commands_need_ros(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where rclpy is missing, each says so, and what works without."""
    monkeypatch.setattr("are_ros.cli.live.find_spec", lambda _: None)
    for words in (("node",), ("guard",), ("play", str(SAMPLE)), ("record", "a.mcap"), ("demo",)):
        assert end_of(monkeypatch, *words) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("are: rclpy is not installed")
        assert "are replay" in line


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--set", "population.mean_life:=-1"), "'population.mean_life': -1.0 is below 0.001 s"),
        (("--set", "nix:=1"), "parameter 'nix': there is no such parameter"),
        (("--params", "none.yaml"), "none.yaml"),
    ],
)
def test_the_node_ends_at_a_bad_parameter(
    ros_available: None, words: tuple[str, ...], sentence: str
) -> None:
    """Status 1 and a sentence, without a traceback."""
    del ros_available
    done = run_process("node", *words)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert sentence in done.stderr.splitlines()[-1]


def test_a_single_value_goes_before_all_files(ros_available: None, tmp_path: Path) -> None:
    """Before those behind --ros-args, too: that of --set is refused, that of the file is good."""
    del ros_available
    file = tmp_path / "good.yaml"
    file.write_text("/ar_builder:\n  ros__parameters:\n    seed: 5\n", encoding="utf-8")
    done = run_process("node", "--set", "seed:=-3", "--ros-args", "--params-file", file)
    assert done.returncode == 1
    assert "seed" in done.stderr.splitlines()[-1]
    assert "-3" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("command", "rule", "status"),
    [
        ("node", "__ns:=/b", 2),
        ("node", "ar_builder:__ns:=/b", 2),
        ("guard", "__ns:=/b", 2),
        ("guard", "ar_guard:__ns:=/b", 2),
        ("guard", "ar_builder:__ns:=/b", 0),
    ],
)
def test_a_node_has_one_namespace(
    ros_available: None, monkeypatch: pytest.MonkeyPatch, command: str, rule: str, status: int
) -> None:
    """Two are refused; ROS would take one of them in silence. A rule for another node is no use."""
    del ros_available
    for program in ("are_ros.node.startup.main", "are_ros.node.guard.main"):
        monkeypatch.setattr(program, lambda _: 0)
    words = [command, "--namespace", "a", "--ros-args", "-r", rule]
    done = CliRunner().invoke(are, words)
    assert done.exit_code == status
    assert ("--namespace and __ns:= are both given" in done.stderr) == (status == 2)


def test_where_nothing_can_be_written_the_node_starts_without_values(
    ros_available: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As in a container whose file system is read-only; with values that is said."""
    del ros_available
    monkeypatch.setattr("are_ros.node.startup.main", lambda _: 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    assert CliRunner().invoke(are, ["node"]).exit_code == 0
    refused = CliRunner().invoke(are, ["node", "--set", "seed:=3"]).exception
    assert isinstance(refused, NodeError)
    why = "in a temporary file: no such file or directory; set TMPDIR to a folder"
    assert why in str(refused)


def test_a_file_is_for_the_namespace_to_which_ros_remaps(
    ros_available: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By a rule for all nodes, or for ours."""
    del ros_available
    monkeypatch.setattr("are_ros.node.startup.main", lambda _: 0)
    file = tmp_path / "b.yaml"
    file.write_text("/b/ar_builder: {ros__parameters: {seed: 5}}", encoding="utf-8")
    for rule, status in (("__ns:=/b", 0), ("ar_builder:__ns:=/b", 0), ("other:__ns:=/b", 1)):
        words = ["node", "--params", str(file), "--ros-args", "-r", rule]
        assert CliRunner().invoke(are, words).exit_code == status


def test_a_process_of_its_own_replays(tmp_path: Path) -> None:
    """`are replay` and `are check` from a real shell."""
    out = tmp_path / "out"
    done = run_process("replay", SAMPLE, "--duration", 1, "--out", out, "--with-inputs")
    assert (done.returncode, done.stdout) == (0, "")
    checked = run_process("check", out)
    assert (checked.returncode, checked.stderr) == (0, "")


def test_a_ctrl_c_that_a_compiled_kernel_turns_into_an_error_interrupts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ends in a sentence, as any other does; the same error without a Ctrl-C is not hidden."""

    def command(**_: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise SystemError("a kernel returned a result with an exception set") from None

    def broken(**_: object) -> None:
        raise SystemError("a kernel is broken")

    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        monkeypatch.setattr(cli, "are", command)
        assert end_of(monkeypatch) == 130
        assert capsys.readouterr().err == "are: interrupted\n"
        monkeypatch.setattr(cli, "are", broken)
        with pytest.raises(SystemError, match="is broken"):
            main()
    finally:
        signal.signal(signal.SIGINT, before)


PRESSING = """
import signal, sys

class Press:
    def find_spec(name, *_):
        if name == sys.argv[-1]:
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Press)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
from are_ros.__main__ import main
main()
"""
"""`are` with a Ctrl-C when it imports the module that is its last word."""


@pytest.mark.parametrize(
    ("module", "status", "said"),
    [("click", -signal.SIGINT, ""), ("are_ros.replay.command", 130, "\nare: interrupted\n")],
)
def test_an_early_ctrl_c_prints_no_traceback(module: str, status: int, said: str) -> None:
    """While the modules of `are` are imported it ends the process, later it interrupts."""
    words = [sys.executable, "-c", PRESSING, "inspect", module]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (status, "", said)


def test_a_backend_of_matplotlib_that_is_not_there_is_no_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The environment names it, as a notebook's does."""
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    done = run_process("describe", "--plot", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "population.png").is_file()


def test_an_output_that_cannot_be_written_is_one_sentence() -> None:
    """As where the result goes to a file, and the disk is full."""
    words = [str(Path(sys.executable).with_name("are")), "inspect", str(SAMPLE)]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    said = "are: the output cannot be written: no space left on device\n"
    assert (done.returncode, done.stderr[-len(said) :]) == (1, said)
    assert "Traceback" not in done.stderr


def test_a_stream_that_is_closed_leads_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by `2>&-`: the bar of a replay could not be made."""
    monkeypatch.setattr("sys.stderr", None)
    monkeypatch.setattr("sys.stdout", None)
    assert end_of(monkeypatch, "inspect", str(SAMPLE)) == 0
    for stream in (sys.stdout, sys.stderr):
        assert stream.name == os.devnull
        stream.close()


HIDING = """
import sys
sys.modules |= dict.fromkeys(sys.argv[1:2])  # as if it could not be found
del sys.argv[1]
from are_ros.__main__ import main
sys.exit(main())
"""
"""`are` where the module that is its first word is not installed."""


@pytest.mark.parametrize(
    ("hidden", "command", "said"),
    [
        ("click", "inspect", "the Python package click is not installed"),
        ("rosbags", "inspect", "the Python package rosbags is not installed"),
        ("numba", "soak", "the Python package numba is not installed"),
        ("mcap", "replay", "the Python package mcap is not installed"),
    ],
)
def test_a_package_that_is_not_installed_is_one_sentence(
    hidden: str, command: str, said: str, tmp_path: Path
) -> None:
    """The node needs fewer packages than `are` does, and pip installs its own alone."""
    made = str(SAMPLE.with_name("sample_office_map.yaml"))
    words = {
        "inspect": [str(SAMPLE)],
        "soak": ["--map", made, "--out", str(tmp_path / "out")],
        "replay": [str(SAMPLE), "--out", str(tmp_path / "out")],
    }[command]
    run = [sys.executable, "-c", HIDING, hidden, command, *words]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr[: len(said) + 5]) == (1, f"are: {said}")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_what_is_not_installed_can_be_installed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that is missing of what was declared; a module of ours that is missing is a fault."""
    missing = {"tqdm", "PIL", "viser", "yaml", "cv2"}
    monkeypatch.setattr("are_ros.errors.find_spec", lambda name: None if name in missing else name)
    cause = ModuleNotFoundError(name="PIL.Image")
    base = [text for text in requires("are_ros") or [] if "extra" not in text]
    wanted = [text for text in base if text.lower().startswith(("opencv", "pyyaml"))]
    said = "the Python package PIL is not installed: python -m pip install "
    assert missing_packages(cause) == said + " ".join(f'"{text}"' for text in wanted)
    assert re.findall(r'"([a-z-]+)>=', missing_packages(cause, ("replay",)))[2:] == [
        "pillow",
        "tqdm",
    ]
    monkeypatch.setattr("are_ros.errors.find_spec", lambda name: name)
    assert missing_packages(cause) == "the Python package PIL is not installed"
    with pytest.raises(ModuleNotFoundError):
        missing_packages(ModuleNotFoundError(name="are_ros.nothing"))


def test_a_soak_that_could_not_be_written_does_not_begin(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The folder of its results is made before, not after minutes of work."""
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("are_ros.lab.soak.soak", lambda *_, **__: pytest.fail("it has begun"))
    made = str(SAMPLE.with_name("sample_office_map.yaml"))
    assert end_of(monkeypatch, "soak", "--map", made, "--out", str(tmp_path / "file")) == 1
    assert capsys.readouterr().err.endswith("the folder cannot be made (it is a file)\n")
