"""The figure of a crack: its panels, and the runs that it refuses."""

import numpy as np
import pytest

import pdjax as pd

MOTION, EXPECTED = pd.scenes.kalthoff(24)


def run(observers, breaking):
    return pd.simulate(MOTION, 40e-6, breaking=breaking, observers=observers, fields=False, show_progress=False)


@pytest.fixture(scope="module")
def broken():
    watch = {"damage": pd.observers.damage(), "tip": pd.observers.crack_tip(EXPECTED.tips[1], (0.37, 0.93))}
    return run(watch, EXPECTED.breaking)


def test_a_plate_is_drawn_with_its_tips_and_its_energies(broken):
    assert np.isfinite(np.asarray(broken.broken_at)).any()
    figure = pd.figures.crack(MOTION.scene.body, broken, tips={"upper": broken.observed["tip"]}, title="plate")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["y  [length]", "way of the tip  [length]", "energy", "damage φ  [-]"]
    lines = {line.get_label(): line for line in figure.axes[1].get_lines()}
    assert np.array_equal(lines["upper"].get_ydata(), broken.observed["tip"])
    assert [line.get_label() for line in figure.axes[2].get_lines()][-1] == "work of loads and supports"


def test_without_tips_the_number_of_broken_bonds_is_drawn(broken):
    figure = pd.figures.crack(MOTION.scene.body, broken)
    count = figure.axes[1].get_lines()[0].get_ydata()
    assert (np.diff(count) >= 0).all() and 2 * count[-1] == np.isfinite(np.asarray(broken.broken_at)).sum()


def test_what_cannot_be_drawn_is_refused(broken):
    with pytest.raises(ValueError, match="bodies of dim 1 and 2; got dim 3"):
        pd.figures.crack(pd.lattice((3, 3, 3)), broken)
    with pytest.raises(ValueError, match="an observer 'phi'; its observers are damage, tip"):
        pd.figures.crack(MOTION.scene.body, broken, damage="phi")
    with pytest.raises(ValueError, match="needs a run with breaking bonds"):
        pd.figures.crack(MOTION.scene.body, run({"damage": pd.observers.damage()}, None))
