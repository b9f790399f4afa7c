//! `stylus calibrate` with an operator at the keyboard: known weights and a known distance.

use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStderr, ChildStdin};
use std::time::Duration;

use crate::support::{Bench, attached, holds, interrupt, json, near, started, wait_for};
use fake_stylus::{FakeStylus, Hand};

/// Force of a weight of 100 g, N.
const WEIGHT_N: f64 = 0.980_665;

/// A person who holds the stylus and answers the command's questions.
struct Operator<'a> {
    stylus: &'a FakeStylus,
    child: Child,
    keyboard: ChildStdin,
    said: Lines<BufReader<ChildStderr>>,
    hand: Hand,
}

impl<'a> Operator<'a> {
    fn new(stylus: &'a FakeStylus, bench: &Bench, command: &str) -> Self {
        let mut child = bench.spawn(command.split(' '));
        Self {
            stylus,
            keyboard: child.stdin.take().unwrap(),
            said: BufReader::new(child.stderr.take().unwrap()).lines(),
            child,
            hand: Hand::default(),
        }
    }

    /// Waits until the command prints `words`, and returns the line.
    fn until(&mut self, words: &str) -> String {
        let said = |line: &std::io::Result<String>| line.as_ref().unwrap().contains(words);
        self.said
            .find(said)
            .unwrap_or_else(|| panic!("'{words}' is not said"))
            .unwrap()
    }

    fn answer(&mut self, words: &str, answer: &str) {
        self.until(words);
        self.stylus.set_hand(self.hand.clone());
        writeln!(self.keyboard, "{answer}").unwrap();
    }

    /// Lays weights on the tip, one after another, when the command asks for each in `grams`. Each is given in newtons
    /// of a sensor of 2 N/V.
    fn weigh(&mut self, weights: &[(&str, f64)]) {
        for (grams, newtons) in weights {
            self.hand.force_n = *newtons;
            self.answer(&format!("with {grams} on the tip"), "");
        }
    }

    /// Moves the tip to the position `goal`, in counts, when the command asks for it.
    fn travel(&mut self, goal: i64) {
        self.answer("put the tip on", "");
        self.until("in a straight line");
        self.hand.goal_counts = Some(goal);
        self.stylus.set_hand(self.hand.clone());
        wait_for("the tip", || {
            self.stylus.pass(Duration::from_millis(20));
            self.stylus.place() == goal
        });
        writeln!(self.keyboard).unwrap();
    }

    /// Holds the stylus in two opposite poses, in which the mean code of each axis is `zero`.
    fn turn_over(&mut self, zero: u16) {
        // Gravity of 9.81 m/s² at 29.72 m/s² per V and 3.3 V / 65 536 per code.
        for (pose, z) in [("tip down", zero + 6_553), ("tip up", zero - 6_553)] {
            self.hand.acceleration = vec![[zero, zero, z]];
            self.answer(pose, "");
        }
    }

    /// Waits for the end of the command, and returns its report and its exit code.
    fn end(mut self) -> (String, Option<i32>) {
        let mut report = String::new();
        let mut output = self.child.stdout.take().unwrap();
        std::io::Read::read_to_string(&mut output, &mut report).unwrap();
        (report, self.child.wait().unwrap().code())
    }
}

fn value(bench: &Bench, setting: &str) -> f64 {
    let got = bench.json(&format!("settings get {setting} --json"));
    got[0]["value"].as_f64().unwrap()
}

/// The sensor has 4 N/V and the wheel 0.02 mm per count. A stylus whose settings were never changed assumes 2 and 0.01.
#[test]
fn weights_and_a_distance_set_both_scales_in_one_change_and_are_measured_again() {
    let (stylus, bench) = started();
    let command = "calibrate --weights 100,200 --distance 50 --seconds 0.2 --json";
    let mut operator = Operator::new(&stylus, &bench, command);
    operator.hand.force_noise = 20;
    let [one, two] = [0.5 * WEIGHT_N, WEIGHT_N];
    operator.weigh(&[("nothing", 0.0), ("100 g", one), ("200 g", two)]);
    operator.weigh(&[("100 g", one), ("nothing", 0.0)]);
    operator.travel(2_500);
    operator.travel(0);
    operator.answer("in the air, tip down", "");
    operator.answer("store these?", "y");
    operator.weigh(&[("nothing", 0.0), ("200 g", two)]);
    operator.travel(2_500);
    let (report, code) = operator.end();
    assert_eq!(code, Some(0), "{report}");
    let report = json(&report);
    near(value(&bench, "force-per-volt"), 4.0, 0.01);
    near(value(&bench, "path-per-count"), 0.02, 1e-6);
    // Noise with an even distribution within ± 20 codes of 0.2 mN has a standard deviation of 2.4 mN.
    let threshold = value(&bench, "contact-threshold");
    assert!((0.02..0.03).contains(&threshold), "{threshold}");
    let set = report["set"].as_array().unwrap().iter();
    let set: Vec<&str> = set.map(|set| set["name"].as_str().unwrap()).collect();
    let names = "force-zero force-per-volt contact-threshold path-per-count";
    assert_eq!(set.join(" "), names);
}

#[test]
fn what_cannot_be_is_refused_with_its_remedy_and_nothing_is_stored() {
    let (stylus, bench) = started();
    let command = "calibrate --weights 100 --seconds 0.2";
    let mut operator = Operator::new(&stylus, &bench, command);
    operator.weigh(&[("nothing", 0.0), ("100 g", WEIGHT_N), ("nothing", 0.1)]);
    let refused = operator.until("nothing was stored");
    holds(&refused, &["see that the tip moves freely"]);
    assert_eq!(operator.end().1, Some(2));
    let mut operator = Operator::new(&stylus, &bench, "calibrate --distance 50 --keep-force");
    operator.travel(2_500);
    operator.travel(200);
    let refused = operator.until("nothing was stored");
    holds(&refused, &["begin and end at the same marks"]);
    assert_eq!(operator.end().1, Some(2));
    assert_eq!(value(&bench, "force-per-volt"), 2.0);
    assert_eq!(value(&bench, "path-per-count"), 0.01);
}

/// The force and the distance differ when they are measured again.
#[test]
fn what_is_not_verified_is_told_with_what_is_stored() {
    let (stylus, bench) = attached(FakeStylus::start_unset());
    let coil = "calibrate --resistance 8 --amplifier-gain 10 --power-limit 0.5 --seconds 0.3";
    let mut operator = Operator::new(&stylus, &bench, coil);
    operator.answer("press Enter", "");
    operator.hand.force_n = 1.0;
    operator.answer("store these?", "y");
    let told = operator.until("not verified");
    let stored = "stored and read back: coil-resistance 8, ";
    holds(&told, &[stored, ", force-zero 4096", "codes from the zero"]);
    assert_eq!(operator.end().1, Some(2));
    assert_eq!(value(&bench, "coil-resistance"), 8.0);

    let mut operator = Operator::new(&stylus, &bench, "calibrate --distance 50 --keep-force");
    operator.travel(2_500);
    operator.travel(0);
    operator.answer("store these?", "y");
    operator.travel(2_000);
    let told = operator.until("not verified");
    let stored = "stored and read back: path-per-count 0.02";
    holds(&told, &[stored, "50 mm show as 40.00 mm"]);
    assert_eq!(operator.end().1, Some(2));
}

#[test]
fn zeros_of_the_accelerometer_are_judged_by_the_accelerometer_and_not_by_a_force_that_is_kept() {
    let (stylus, bench) = started();
    let command = "calibrate --resistance 8 --amplifier-gain 10 --power-limit 0.5 --seconds 0.2 --accelerometer \
                   --keep-force";
    let mut operator = Operator::new(&stylus, &bench, command);
    operator.hand.is_open = true;
    operator.turn_over(33_000);
    operator.answer("store these?", "y");
    let (report, code) = operator.end();
    assert_eq!(code, Some(0), "{report}");
    assert_eq!(value(&bench, "acceleration-zero-z"), 33_000.0);
    let mut operator = Operator::new(&stylus, &bench, command);
    operator.hand.acceleration = vec![[30_000; 3], [34_000; 3]];
    operator.answer("tip down", "");
    holds(&operator.until("nothing was stored"), &["acceleration X has a noise"]);
    assert_eq!(operator.end().1, Some(2));
}

#[test]
fn what_is_asked_for_beside_a_response_is_set_and_told_if_the_response_fails() {
    let (stylus, bench) = started();
    let command = "calibrate --response --accelerometer --keep-force --seconds 0.2";
    let mut operator = Operator::new(&stylus, &bench, command);
    operator.turn_over(33_000);
    operator.answer("store these?", "y");
    operator.until("hold the stylus as in use");
    interrupt(&operator.child);
    writeln!(operator.keyboard).unwrap();
    let told = operator.until("the response failed: interrupted");
    holds(&told, &["stored and read back: acceleration-zero-x 33000, "]);
    assert_eq!(operator.end().1, Some(2));
    assert_eq!(value(&bench, "acceleration-zero-x"), 33_000.0);
    let refused = bench.refuse("calibrate --response --hard-limit 0.4 --yes");
    holds(&refused, &["give --resistance"]);
}
