//! `stylus compare`: the page as a listener uses it, in a browser, and the score of its answers.

use std::time::{Duration, Instant};

use crate::support::browser::Browser;
use crate::support::{Bench, scaled, two_textures};
use host_tools::dsp::binomial::clopper_pearson;
use serde_json::Value;

const PAGE: &str =
    "compare set --library textures.lib --out page.html --segment 0.4 --trials 14 --seed 9";

/// Recordings of two textures, and their library.
fn fitted() -> Bench {
    let bench = two_textures(|signal| [scaled(signal, 1.0)]);
    bench.succeed("fit set --out textures.lib --order 20");
    bench
}

/// The plan in a page: what is right in each trial.
fn key(bench: &Bench, page: &str) -> Value {
    let text = std::fs::read_to_string(bench.path(page)).unwrap();
    let (_, rest) = text.split_once("id=\"plan\">").unwrap();
    let (plan, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(plan).unwrap()
}

/// The letter that is right.
fn right(trial: &Value) -> usize {
    usize::from(trial["a"] != trial["x"])
}

#[test]
fn the_seed_decides_the_page_and_its_size_is_said() {
    let bench = fitted();
    let said = bench.succeed(PAGE);
    let one = std::fs::read(bench.path("page.html")).unwrap();
    assert!(said.contains("14 trials") && said.contains(" MB"), "{said}");
    assert!(!said.contains("SIMULATED"), "{said}");
    let megabytes = format!("{:.1} MB", one.len() as f64 / 1e6);
    assert!(said.contains(&megabytes), "{said}");
    bench.succeed(PAGE);
    assert_eq!(std::fs::read(bench.path("page.html")).unwrap(), one);
    bench.succeed(&PAGE.replace("--seed 9", "--seed 10"));
    let other = key(&bench, "page.html");
    assert_eq!(other["trials"].as_array().unwrap().len(), 14);
    assert_ne!(std::fs::read(bench.path("page.html")).unwrap(), one);
}

#[test]
fn what_cannot_be_compared_is_refused_with_the_remedy() {
    let bench = fitted();
    for (arguments, word) in [
        (
            "compare set --library textures.lib --out p.html --pairs gaussian-fitted",
            "nothing to compare",
        ),
        ("compare --score none.csv", "none.csv"),
        (
            "compare --score textures.lib",
            "line 1: is not UTF-8 text: save the file as UTF-8; give a file that the page of `stylus compare` saved",
        ),
    ] {
        let message = bench.refuse(arguments);
        assert!(message.contains(word), "{arguments}: {message}");
    }
    std::fs::remove_file(bench.path("textures.lib.fit.json")).unwrap();
    let message = bench.refuse(PAGE);
    assert!(message.contains("--takes"), "{message}");
    let output = bench.run("compare set --library textures.lib --out p.html --segment 0.01");
    assert!(!output.status.success());
}

/// A listener who answers right but in every third trial, by keys and by the mouse, and reloads the page in between.
struct Listener<'a> {
    browser: &'a mut Browser,
    bench: &'a Bench,
}

impl Listener<'_> {
    /// The trial in which the page is loaded again, after A was heard.
    const RELOADS_IN: usize = 5;

    fn is_right(number: usize) -> bool {
        !number.is_multiple_of(3)
    }

    /// Plays X once more than needed in every other trial, and A in the one with the reload.
    fn replays(number: usize) -> usize {
        number % 2 + usize::from(number == Self::RELOADS_IN)
    }

    /// Answers trial `number` of `total`. Returns the answer: 0 for A, 1 for B.
    fn answer(&mut self, number: usize, total: usize, trial: &Value) -> usize {
        if number == Self::RELOADS_IN {
            self.reload();
        }
        let browser = &mut *self.browser;
        if number == 12 {
            browser.wait("!document.getElementById('break').hidden");
            assert_eq!(browser.value("document.activeElement.id"), "break-title");
            browser.click("go-on");
        }
        browser.wait(&format!(
            "!document.getElementById('trial').hidden && \
             document.getElementById('trial-title').textContent === 'Trial {} of {total}'",
            number + 1
        ));
        // Blind: nothing that is seen names a kind.
        let visible = browser.value("document.body.innerText + document.title");
        let visible = visible.as_str().unwrap().to_lowercase();
        for kind in ["recording", "gaussian", "fitted"] {
            assert!(!visible.contains(kind), "{visible}");
        }
        // An answer before all three were heard is none.
        browser.press('1');
        let answer = right(trial) ^ usize::from(!Self::is_right(number));
        if number.is_multiple_of(2) {
            for (index, key) in ['a', 'b', 'x'].into_iter().enumerate() {
                browser.press(key);
                let kept = "JSON.parse(localStorage.getItem(Object.keys(localStorage)[0]))";
                browser.wait(&format!("{kept}.plays[{index}] > 0"));
            }
            browser.wait("!document.getElementById('answer-0').disabled");
            browser.press(['1', '2'][answer]);
        } else {
            for index in [0, 1, 2, 2] {
                let plays = "JSON.parse(localStorage.getItem(Object.keys(localStorage)[0])).plays";
                let sum = format!("{plays}.reduce((a, b) => a + b)");
                let before = browser.value(&sum);
                browser.click(&format!("play-{index}"));
                browser.wait(&format!("{sum} === {before} + 1"));
            }
            browser.click(&format!("answer-{answer}"));
        }
        answer
    }

    /// Hears A, loads the page again, and goes on: what was heard before counts.
    fn reload(&mut self) {
        let missing = "document.getElementById('hint').textContent.startsWith('Hear B and X')";
        self.browser.press('a');
        self.browser.wait(missing);
        self.browser.open(&self.bench.path("page.html"));
        let begin = self
            .browser
            .value("document.getElementById('begin').textContent");
        assert_eq!(begin, format!("Go on with trial {}", Self::RELOADS_IN + 1));
        self.browser.click("begin");
        self.browser.wait(missing);
    }

    /// Saves the answers. Returns the file's path.
    fn save(&mut self, page: &str) -> std::path::PathBuf {
        self.browser.click("save");
        let saved = self.bench.path(&format!("answers-{page}.csv"));
        let begin = Instant::now();
        while !saved.exists() {
            assert!(
                begin.elapsed() < Duration::from_secs(30),
                "no file was saved"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        saved
    }
}

#[test]
#[ignore = "needs Chromium; tests/run runs it"]
fn a_listener_answers_reloads_and_saves_and_the_count_is_that_of_the_seeds_key() {
    let bench = fitted();
    bench.succeed(PAGE);
    let key = key(&bench, "page.html");
    let trials = key["trials"].as_array().unwrap();
    let mut browser = Browser::start(&bench.path(""));
    browser.open(&bench.path("page.html"));
    let visible = browser.value("document.body.innerText");
    let instructions = visible
        .as_str()
        .unwrap()
        .contains("X is of the same kind as A");
    assert!(instructions, "{visible}");
    browser.click("level");
    browser.click("begin");
    let mut listener = Listener {
        browser: &mut browser,
        bench: &bench,
    };
    let given: Vec<usize> = trials
        .iter()
        .enumerate()
        .map(|(number, trial)| listener.answer(number, trials.len(), trial))
        .collect();
    listener
        .browser
        .wait("!document.getElementById('end').hidden");
    let saved = listener.save(key["page"].as_str().unwrap());
    let correct = (0..trials.len()).filter(|n| Listener::is_right(*n)).count() as u32;
    let total = trials.len() as u32;
    let cells = browser.value(
        "[...document.querySelectorAll('#results tbody tr')].map((row) => [...row.cells].map((c) => c.textContent))",
    );
    let (low, high) = clopper_pearson(correct, total, 0.95);
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let interval = format!("{} to {}", percent(low), percent(high));
    for (cell, expected) in [
        (1, correct.to_string()),
        (2, total.to_string()),
        (4, interval),
    ] {
        assert_eq!(cells[0][cell], expected, "{cells}");
    }
    let mut reader = csv::Reader::from_path(&saved).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), trials.len());
    for (number, (row, trial)) in rows.iter().zip(trials).enumerate() {
        let field = |name: &str| trial[name].as_str().unwrap();
        assert_eq!(&row[0], (number + 1).to_string());
        assert_eq!(
            [&row[1], &row[2], &row[3], &row[4]],
            ["pair", "a", "b", "x"].map(field)
        );
        assert_eq!(&row[5], ["A", "B"][given[number]]);
        assert_eq!(&row[6], u8::from(Listener::is_right(number)).to_string());
        assert_eq!(&row[7], Listener::replays(number).to_string(), "{row:?}");
        let seconds: f64 = row[8].parse().unwrap();
        assert!(seconds > 0.0 && seconds < 600.0, "{row:?}");
        assert_eq!(&row[9], field("surface"));
        assert_eq!(&row[11], "recorded");
    }
    let score = bench.succeed(&format!("compare --score {}", saved.display()));
    let line = score
        .lines()
        .find(|line| line.starts_with("recording-gaussian"))
        .unwrap();
    let words: Vec<&str> = line.split_whitespace().collect();
    assert_eq!(
        words[1..4],
        ["1", "14", correct.to_string().as_str()],
        "{score}"
    );
    let (requests, errors) = browser.requests_and_errors();
    let own = ["file:", "data:", "blob:", "about:"];
    let is_own = |url: &String| own.iter().any(|own| url.starts_with(own));
    assert!(
        requests.len() >= 2 && requests.iter().all(is_own),
        "{requests:?}"
    );
    assert!(errors.is_empty(), "{errors:?}");
}

#[test]
#[ignore = "needs Chromium; tests/run runs it"]
fn the_pages_intervals_are_those_of_the_host() {
    let bench = fitted();
    bench.succeed(PAGE);
    let mut browser = Browser::start(&bench.path(""));
    browser.open(&bench.path("page.html"));
    let cases: Vec<(u32, u32)> = (1..40)
        .flat_map(|trials| (0..=trials).map(move |successes| (successes, trials)))
        .chain([(777, 1200), (3000, 5000), (0, 4000), (1999, 2000)])
        .collect();
    let list = serde_json::to_string(&cases).unwrap();
    let found = browser.value(&format!(
        "{list}.map(([k, n]) => clopperPearson(k, n, 0.95))"
    ));
    for (&(successes, trials), ends) in cases.iter().zip(found.as_array().unwrap()) {
        let (low, high) = clopper_pearson(successes, trials, 0.95);
        for (host, page) in [(low, &ends[0]), (high, &ends[1])] {
            let page = page.as_f64().unwrap();
            assert!(
                (host - page).abs() < 1e-9,
                "{successes} of {trials}: {host}, {page}"
            );
        }
    }
}

#[test]
#[ignore = "needs Chromium; tests/run runs it"]
fn all_text_has_contrast_and_every_button_has_a_name_in_light_and_dark() {
    let bench = fitted();
    bench.succeed(&PAGE.replace("--trials 14", "--trials 1"));
    let mut browser = Browser::start(&bench.path(""));
    browser.open(&bench.path("page.html"));
    let check = |browser: &mut Browser, at: &str| {
        for scheme in ["light", "dark"] {
            browser.prefer(scheme);
            let least = browser.least_contrast();
            assert!(least >= 4.5, "{at}, {scheme}: {least}");
            let folder = std::env::var("STYLUS_SCREENSHOTS");
            if let Ok(folder) = folder {
                let picture = browser.screenshot();
                let path = format!("{folder}/compare-{at}-{scheme}.png.base64");
                std::fs::write(path, picture).unwrap();
            }
        }
        let nameless = "[...document.querySelectorAll('button, progress')].filter((e) => \
             (e.getAttribute('aria-label') ?? e.textContent).trim() === '').length";
        assert_eq!(browser.value(nameless), 0);
    };
    check(&mut browser, "start");
    browser.click("begin");
    check(&mut browser, "trial");
    for key in ['a', 'b', 'x'] {
        browser.press(key);
        browser.wait(&format!(
            "document.getElementById('play-{}').getAttribute('aria-pressed') === 'true'",
            "abx".find(key).unwrap()
        ));
    }
    browser.wait("!document.getElementById('answer-0').disabled");
    check(&mut browser, "heard");
    browser.press('2');
    browser.wait("!document.getElementById('end').hidden");
    check(&mut browser, "end");
}
