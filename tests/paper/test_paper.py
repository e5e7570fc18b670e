"""The paper: numbers of its slips, claims, pictures, and the command that prints them."""

import json
import pathlib
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod

ROOT = pathlib.Path(__file__).parents[2]
CONSTANTS = next(
    case["outputs"]
    for case in json.loads((ROOT / "tests" / "truth.json").read_text())["cases"]
    if case["name"] == "paper_error_constants"
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    return folder, jaxrod.claims.report(folder)


def test_slips_carry_the_right_numbers():
    slips = {slip.place: slip for slip in jaxrod.paper.slips()}
    assert f"{CONSTANTS['c_eq12_as_printed']:.2g}" in slips["(12)"].printed
    assert f"{CONSTANTS['c_eq14']:.5g}" in slips["(14)"].printed
    assert f"{CONSTANTS['c_energy']:.5g}" in slips["(14)"].right
    assert f"{100 * (CONSTANTS['ratio_energy_series'] - 1):.1f} % more" in slips["(14)"].right
    assert f"{CONSTANTS['x_C']:.5f}" in slips["(15)"].right
    assert f"{-100 * CONSTANTS['lever_error']:.1f} % too small" in slips["(15)"].right


def test_literal_and_corrected_scenes():
    body = jaxrod.paper.literal().rod
    assert float(body.stiffness) == pytest.approx(CONSTANTS["c_eq14"], rel=1e-14)
    assert float(body.first_moment) == pytest.approx(
        float(jaxrod.paper.rod().mass) * CONSTANTS["lever_in_15"], rel=1e-14
    )
    assert float(body.inertia) == pytest.approx(float(jaxrod.paper.rod().moment_of_inertia()), rel=1e-14)


def test_bands_and_frequency_of_a_known_signal():
    """3 % at 2.5 Hz and 1 % at 23.3 Hz, which lies between the lines of the spectrum."""
    ts = np.linspace(0.0, 10.0, jaxrod.paper.SAMPLES)
    slow, fast = 0.03 * np.sin(2 * np.pi * 2.5 * ts), 0.01 * np.cos(2 * np.pi * 23.3 * ts)
    inner = slice(2000, -2000)
    found_slow, found_fast = jaxrod.claims.split_bands(ts, 0.5 + slow + fast)
    assert np.max(np.abs(found_slow - 0.5 - slow)[inner]) < 3e-4
    assert np.max(np.abs(found_fast - fast)[inner]) < 3e-4
    assert jaxrod.claims.frequency(ts, found_fast) == pytest.approx(23.3, rel=1e-5)


@pytest.mark.parametrize(
    ("sentence", "parts", "verdict"),
    [
        ("energy", ["10 s", "1e-11"], "holds; but"),
        ("oscillates", ["142.76 rad/s", "ω_ε = 140.49", "146.5", "ω_ε = 144.34"], "holds"),
        ("antiphase", ["-0.999", "+0.9998"], "fast band alone"),
        ("0.4 s", ["0.429 s"], "holds"),
        ("1.1 times", ["1.1027", "10.27 %"], "uniform rod"),
        ("about 10 %", ["16.2 %", "19.4 %"], "does not hold"),
        ("release", ["0.54", "0.89"], "holds"),  # maxima over four wave travels
        ("slowly", ["-0.2 %", "-13.1 %"], "shape"),
    ],
)
def test_claims(report, sentence, parts, verdict):
    line = next(line for line in report[1].splitlines() if sentence in line.split("|")[1:2][0:1].__str__())
    assert all(part in line for part in parts) and verdict in line


def test_report_writes_pictures_and_data(report):
    folder, text = report
    assert {path.name for path in folder.iterdir()} == {
        "claims.md", "figure2.png", "release.png", "figure2_literal.csv", "figure2_corrected.csv",
    }  # fmt: skip
    table = np.loadtxt(folder / "figure2_corrected.csv", delimiter=",", skiprows=1)
    assert table.shape == (jaxrod.paper.SAMPLES, 4)
    assert table[-1, 1] == pytest.approx(146.434545534944, abs=1e-8)  # psi(10 s), 13 digits in truth.json
    assert "bending" in text and "2.56 Hz" in text


def test_readme_shows_the_report(report):
    """The README's table is the one that the command prints."""
    shown = (ROOT / "README.md").read_text().split("<!-- claims -->")[1].split("<!-- /claims -->")[0].strip()
    assert shown in report[1]
    assert shown.count("\n") == 11


@pytest.mark.parametrize(
    ("ratio", "taus", "tips"),
    [
        (1.0, [0.5, 1.0, 1.5, 2.0, 3.0], [0.5, 0.0, -0.5, -1.0, 0.0]),  # the uniform rod's triangle wave
    ],
)
def test_release_series(ratio, taus, tips):
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.02 * ratio), 1e7, 1200.0)
    ts = np.asarray(taus) / float(rod.wave_speed)
    moved = jaxrod.continuum.release(jaxrod.System(rod, jaxrod.Rotation()), 0.01, ts, n=400)
    assert np.max(np.abs(np.asarray(moved) / 0.01 - tips)) < 2e-3  # kinks: the series converges as 1 / n


@pytest.mark.parametrize(
    ("section", "stretch"),
    [
        # tip displacement over length at half the critical spin, 6 digits; uniform rod also tan K / K - 1
        (jaxrod.Uniform(0.02), 0.273240),
        (jaxrod.Cone(0.02, 0.03), 0.267098),
        (jaxrod.Cone(0.03, 0.02), 0.280144),
    ],
    ids=["uniform", "1.5", "2/3"],
)
def test_steady_spin(section, stretch):
    system = jaxrod.System(jaxrod.Rod(1.0, section, 1e7, 1200.0), jaxrod.Rotation())
    critical = 2 * np.pi * jaxrod.continuum.natural_frequencies(system, 1)[0]
    assert float(jaxrod.continuum.steady_spin(system, critical / 2)) == pytest.approx(stretch, abs=1e-6)


@pytest.mark.slow
def test_command_line(tmp_path):
    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "jaxrod", *arguments], capture_output=True, text=True, cwd=tmp_path
        )

    assert "paper" in run("--help").stdout
    assert run("--version").stdout.strip() == f"jaxrod {jaxrod.__version__}"
    wrong = run("papr")
    assert wrong.returncode == 2 and "invalid choice: 'papr'" in wrong.stderr
    (tmp_path / "file").touch()
    refused = run("paper", "--out", "file")
    assert refused.returncode == 2 and "--out file is a file; give a folder" in refused.stderr
    done = run("paper")
    assert done.returncode == 0 and "(5) with another inertia" in done.stdout
    assert (tmp_path / "paper" / "figure2.png").stat().st_size > 20_000


@pytest.mark.parametrize(("tip", "roots"), [(0.0, [1.0, 2.0, 3.0]), (0.02, [0.5, 1.5, 2.5])])
def test_pointed_and_uniform_tips(tip, roots):
    """kappa = n pi for a rod that ends in a point: the ends of the intervals that the roots lie in."""
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, tip), 1e7, 1200.0)
    found = jaxrod.continuum.natural_frequencies(jaxrod.System(rod, jaxrod.Rotation()), 3)
    assert np.asarray(found) * 2 / float(rod.wave_speed) == pytest.approx(roots, rel=1e-13)


def test_closed_forms_of_a_rod_held_elsewhere_are_refused():
    rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), 1e7, 1200.0)
    for motion in (jaxrod.Flight(), jaxrod.Rotation(pivot=0.5)):
        with pytest.raises(ValueError, match="of a rod held at its root"):
            jaxrod.continuum.release(jaxrod.System(rod, motion), 0.01, jnp.array([0.1]))
