"""Analyses recover what simulated listeners were made with. A share of intervals is held within three standard
deviations of its binomial distribution. Listeners are simulated by draws, and not by the formulas that are judged."""

import csv
import math
import runpy
from pathlib import Path

import numpy as np
import pytest
import stylus_haptics as sh
from stylus_haptics import psychophysics
from stylus_haptics.psychophysics import MODELS

LEVELS_DB = [8 * 2 ** (n / 4) for n in range(-16, 1)]


def fewest(share: float, of: int) -> float:
    """What falls short of it does so by chance in about one of 700 tests."""
    return share * of - 3 * math.sqrt(share * (1 - share) * of)


@pytest.mark.parametrize("model", MODELS)
def test_the_interval_of_d_prime_holds_the_truth_of_95_in_100_listeners(model):
    generator = np.random.default_rng(1)
    for d_prime in (0.6, 1.2, 2.4):
        held = 0
        for _ in range(400):
            right = int(psychophysics.simulated_abx(d_prime, 100, generator, model).sum())
            found = psychophysics.sensitivity(right, 100, model=model)
            assert found.low <= found.d_prime <= found.high
            held += found.low <= d_prime <= found.high
        # Exact intervals are too wide rather than too narrow, and not much: within 98.5 % here.
        assert fewest(0.95, 400) <= held <= 0.985 * 400 + 3, (d_prime, held)


@pytest.mark.parametrize("model", MODELS)
def test_the_proportion_at_a_d_prime_is_that_of_listeners_and_turns_back_into_it(model):
    generator = np.random.default_rng(2)
    for d_prime in (0.0, 1.0, 2.5):
        share = psychophysics.abx_proportion(d_prime, model)
        right = psychophysics.simulated_abx(d_prime, 20_000, generator, model).sum()
        assert abs(right / 20_000 - share) < 3 * math.sqrt(share * (1 - share) / 20_000)
        assert psychophysics.abx_d_prime(share, model) == pytest.approx(d_prime, abs=1e-6)
    assert psychophysics.abx_d_prime(0.3, model) == 0 and psychophysics.abx_d_prime(1, model) == math.inf


def test_an_interval_leaves_half_of_what_the_confidence_leaves_on_either_side():
    for trials in (1, 12, 40):
        for right in range(trials + 1):
            low, high = psychophysics.proportion_interval(right, trials)
            term = lambda share, n: math.comb(trials, n) * share**n * (1 - share) ** (trials - n)
            chance = lambda share, counts: sum(term(share, n) for n in counts)
            assert right == 0 or chance(low, range(right, trials + 1)) == pytest.approx(0.025)
            assert right == trials or chance(high, range(right + 1)) == pytest.approx(0.025)


def test_staircases_come_to_the_strength_of_70_7_per_cent():
    generator = np.random.default_rng(3)
    for slope, truth_db in [(1.0, 1.4), (1.5, 2.0), (2.0, 4.0)]:
        at_truth = psychophysics.abx_d_prime(psychophysics.TWO_DOWN_ONE_UP)
        d_prime_of = lambda strength: at_truth * (strength / truth_db) ** slope
        found = []
        for _ in range(300):
            (one,) = psychophysics.thresholds(psychophysics.simulated_staircase(d_prime_of, LEVELS_DB, generator, 200))
            assert one.reversals == 12 and one.part == "level"
            found.append(math.log(one.threshold))
        # At the mean threshold answers are right in 67.7 to 73.7 %: steps of finite size shift it, most where d' rises
        # steeply.
        share = psychophysics.abx_proportion(d_prime_of(math.exp(np.mean(found))))
        assert abs(share - psychophysics.TWO_DOWN_ONE_UP) < 0.03, (slope, share)


def test_rows_that_no_staircase_has_asked_for_are_refused():
    rows = psychophysics.simulated_staircase(lambda strength: strength, LEVELS_DB, np.random.default_rng(4))
    psychophysics.thresholds(rows)
    rows[4]["correct"] = 1 - rows[4]["correct"]
    with pytest.raises(ValueError, match="as the page saved it"):
        psychophysics.thresholds(rows)


@pytest.mark.parametrize("step", [10**9, 0, -(10**12)])
def test_a_step_that_no_grid_has_is_named_and_no_grid_is_made_for_it(step):
    rows = psychophysics.simulated_staircase(lambda strength: strength, LEVELS_DB, np.random.default_rng(4))
    rows[0]["step"] = step
    with pytest.raises(ValueError, match=f"at step {step}.*1 to 1000"):
        psychophysics.thresholds(rows)


def test_a_mixed_model_recovers_what_ratings_were_made_with():
    pytest.importorskip("statsmodels")
    generator = np.random.default_rng(5)
    means = {"recording-fitted": 70.0, "recording-gaussian": 40.0, "recording-recording": 85.0}
    held, errors, runs = 0, [], 20
    for _ in range(runs):
        found = psychophysics.ratings(psychophysics.simulated_ratings(means, 10, 4, generator))
        assert [one.pair for one in found] == ["recording-recording", "recording-fitted", "recording-gaussian"]
        truths = [means[one.pair] - means["recording-recording"] for one in found[1:]]
        held += sum(one.low <= truth <= one.high for one, truth in zip(found[1:], truths))
        errors.append([one.difference - truth for one, truth in zip(found[1:], truths)])
    assert held >= fewest(0.95, 2 * runs), held
    # The deviation of a difference of two means of ten listeners, each 5 apart by pair and 10 by trial, of four trials.
    deviation = math.sqrt(2 * (5**2 + 10**2 / 4) / 10)
    assert (abs(np.mean(errors, axis=0)) < 3 * deviation / math.sqrt(runs)).all()


def test_files_of_a_page_are_read_with_numbers_and_others_are_refused(tmp_path):
    place = tmp_path / "answers.csv"
    header = "design,listener,trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin".split(",")
    with open(place, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(header)
        for trial in range(1, 5):
            correct = int(trial < 4)
            answer = ["r-g", "r", "g", "r", "AB"[1 - correct], correct]
            table.writerow(["abx", 7, trial, *answer, 0, 2.5, "felt, 1 N", "p", "recorded"])
    (found,) = psychophysics.sensitivities(psychophysics.read(place))
    assert (found.pair, found.right, found.trials) == ("r-g", 3, 4)
    with pytest.raises(ValueError, match="--design staircase"):
        psychophysics.thresholds(psychophysics.read([place]))
    saved = place.read_text()
    # As a German spreadsheet saves it, and in the data of an experiment with other trials.
    german = "\n".join(";".join(row).replace(".", ",") for row in csv.reader(saved.splitlines()))
    place.write_text(german + "\n")
    (again,) = psychophysics.sensitivities(psychophysics.read(place))
    assert again == found and psychophysics.read(place)[0]["seconds"] == 2.5
    place.write_text(saved + ",rub" + "," * (len(header) - 2) + "\n")
    assert len(psychophysics.read(place)) == 4
    (scored,) = sh.score([place])
    assert (scored["correct"], scored["trials"]) == (found.right, found.trials)
    for refused, word in ((saved.replace("A,1", "A,0", 1), "changed"), ("file,texture\na.wav,felt\n", "listener")):
        place.write_text(refused)
        for read in (psychophysics.read, sh.score):
            with pytest.raises(sh.StylusError, match=f"answers.csv.*{word}"):
                read([place])
    place.write_text(saved)
    copy = tmp_path / "copy.csv"
    copy.write_text(saved)
    with pytest.raises(sh.StylusError, match="copy.csv.*answers.csv"):
        psychophysics.read([place, copy])


def test_the_example_finds_what_its_listeners_were_made_with(capsys):
    example = Path(__file__).parent.parent / "examples" / "analyse_listening.py"
    runpy.run_path(str(example))["main"]([])
    told = capsys.readouterr().out
    found = [line for line in told.splitlines() if "d' " in line and "listener" in line and " of 60" in line]
    assert "SIMULATED" in told and len(found) == 9
    # Of 9 intervals of 95 % one may miss.
    truths = [float(line.split("d' ")[1].split()[0]) for line in found]
    intervals = [line.rsplit("(", 1)[1].rstrip(")").split(" to ") for line in found]
    assert sum(float(low) <= truth <= float(high) for truth, (low, high) in zip(truths, intervals)) >= 8
    assert told.count("after") == 3
