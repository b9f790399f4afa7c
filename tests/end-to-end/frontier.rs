//! The frontier of accuracy against computing time.

use crate::support::{Bench, denim_rig_of, holds, json, near, text};
use host_tools::evaluation::frontier::costs::Costs;
use host_tools::evaluation::frontier::{Filter, Frontier, INTERVALS, Material, Options, Prepared, Structure};
use host_tools::evaluation::stress::cases::{Length, suite};
use host_tools::fit::Order;
use host_tools::recording::RecordingSet;
use host_tools::report::frontier_page;
use host_tools::rig::{self, RigFile};

/// Two takes of denim at two speeds and two forces.
fn simulated() -> Bench {
    let bench = Bench::new();
    let rig = denim_rig_of("100, 120", "0.6, 0.8");
    let rig = RigFile::from_toml(&bench.path("rig.toml"), &rig).unwrap();
    for seed in [5, 6] {
        rig::simulate_to_folder(&rig, seed, &bench.path(&format!("rig{seed}")), false).unwrap();
    }
    bench
}

fn set(bench: &Bench, name: &str) -> RecordingSet {
    RecordingSet::open(&[bench.path(name)]).unwrap()
}

/// Options with two orders and two of the hard cases only, because all of them take minutes.
fn options() -> Options {
    let wanted = ["H1b", "H2a/H2b, saw 1"];
    let cases = suite(Length::Short).into_iter();
    let options = Options {
        orders: vec![20, 100],
        cases: cases.filter(|case| wanted.contains(&case.name.as_str())).collect(),
        ..Options::default()
    };
    assert_eq!(options.cases.len(), wanted.len());
    options
}

fn run(material: &Material, options: &Options, threads: usize) -> Frontier {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
        .install(|| {
            let prepared = Prepared::new(material, options, || ()).unwrap();
            let done = std::sync::atomic::AtomicUsize::new(0);
            let count = || {
                done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            };
            let frontier = prepared.run(options, count).unwrap();
            assert_eq!(done.into_inner(), prepared.work());
            frontier
        })
}

#[test]
fn a_comparison_is_the_same_on_any_number_of_threads_and_says_what_the_structures_promise() {
    let bench = simulated();
    let material = Material::takes(set(&bench, "rig5"), set(&bench, "rig6")).unwrap();
    // Only a part is computed, because all of it takes one thread half a minute.
    let small = Options {
        orders: vec![20],
        cases: options().cases.split_off(1),
        ..Options::default()
    };
    let on = |threads| serde_json::to_string(&run(&material, &small, threads)).unwrap();
    assert_eq!(on(3), on(1));
    let frontier = run(&material, &options(), 3);
    assert_eq!(frontier.nodes, 4);
    assert_eq!(frontier.filters.len(), 3 * 4);
    assert_eq!(frontier.points.len(), 3 * 4 * INTERVALS.len());
    for (index, filter) in frontier.filters.iter().enumerate() {
        check_filter(&frontier, index, filter);
    }
    // Only the lattice keeps the hard cases stable. A lattice must be on the front of the structures that do.
    let structures: Vec<_> = frontier
        .points
        .iter()
        .filter(|point| point.on_safe_front)
        .map(|p| frontier.filters[p.filter].structure)
        .collect();
    assert!(!structures.is_empty());
    let lattice = Structure::NormalisedLattice32;
    assert!(structures.iter().all(|s| *s == lattice));
    let choices = frontier.choices();
    assert_eq!(choices.len(), 3);
    assert!(choices.iter().all(|(_, choice)| choice.on_safe_front));
    assert!(choices.is_sorted_by(|(_, a), (_, b)| { a.cycles <= b.cycles && a.total_error_db >= b.total_error_db }));
    // Two takes differ as much as two pieces of one surface.
    assert!(frontier.take_cost > 0.05 && frontier.take_band_error_db > 0.1);
    page_holds_all(&bench, &frontier);
}

/// Asserts the accuracy that each structure must have.
fn check_filter(frontier: &Frontier, index: usize, filter: &Filter) {
    let at = |order| {
        let mut same = frontier
            .filters
            .iter()
            .filter(|other| other.structure == filter.structure);
        same.find(|other| other.order == Order::Fixed(order)).unwrap()
    };
    let name = format!("{}, {}", filter.structure, filter.order_text());
    assert!(at(100).still.cost < at(20).still.cost - 0.05, "{name}");
    assert!(at(100).m4.sample.cycles > at(20).m4.sample.cycles, "{name}");
    let points: Vec<_> = frontier.points.iter().filter(|p| p.filter == index).collect();
    assert_eq!(points.len(), INTERVALS.len());
    if filter.refused_textures.is_empty() {
        assert!(
            points
                .iter()
                .map(|point| point.motion_error_db)
                .is_sorted_by(|a, b| a <= &(b + 0.05)),
            "{name}"
        );
        assert!(
            points.iter().map(|point| point.cycles).is_sorted_by(|a, b| a >= b),
            "{name}"
        );
    }
    let is_in_32_bits = filter.structure != Structure::DirectForm16;
    assert_eq!(filter.still.mean_snr_db > 70.0, is_in_32_bits, "{name}");
    if filter.structure == Structure::NormalisedLattice32 {
        assert_eq!(filter.hard.held, filter.hard.cases, "{name}");
        assert!(points[0].motion_error_db < 0.05, "{name}");
        assert!(filter.still.lowest_snr_db > 100.0, "{name}");
    } else {
        assert!(filter.hard.held < filter.hard.cases, "{name}");
        assert!(!filter.hard.worst_case.is_empty(), "{name}");
    }
}

fn page_holds_all(bench: &Bench, frontier: &Frontier) {
    frontier_page::write(frontier, &bench.path("page.html")).unwrap();
    let page = text(&bench.read("page.html"));
    assert_eq!(page.matches("class=\"plot\"").count(), 2);
    let (_, main) = page.split_once("<main>").unwrap();
    let (before_folds, _) = main.split_once("<details>").unwrap();
    assert!(before_folds.contains(&*host_tools::report::html::escaped(&frontier.answer())));
    let (_, picture) = before_folds.split_once("<svg").unwrap();
    let texts = picture
        .split("<text")
        .skip(1)
        .map(|text| text.split(['>', '<']).nth(1).unwrap().trim());
    let labels: Vec<&str> = texts
        // Labels of ticks are numbers, or empty where there is no space.
        .filter(|text| !text.is_empty() && text.parse::<f64>().is_err())
        .collect();
    assert!(labels.len() <= 13, "SIMULATED and twelve: {labels:?}");
    for (name, _) in frontier.choices() {
        assert!(labels.contains(&name), "{name}: {labels:?}");
    }
    for structure in Structure::ALL {
        let named = page.matches(&structure.to_string()).count();
        assert!(named > 8, "{structure}");
    }
    holds(&page, &["SIMULATED", "168 MHz", "Pareto"]);
    holds(&page, &[&frontier.rustc, &frontier.qemu]);
    // The script that shows the pictures' values contains this word.
    let (before, _) = page.split_once("<script").unwrap();
    assert!(!before.contains("NaN"), "a figure is missing");
    for peer in &Costs::measured().table().peers {
        let name = host_tools::report::html::escaped(&peer.name);
        assert!(page.contains(&*name), "{}", peer.name);
    }
    let numbers = json(&frontier.to_json());
    let points = numbers["points"].as_array().unwrap();
    assert_eq!(points.len(), frontier.points.len());
    assert_eq!(numbers["simulated"], true);
}

#[test]
fn a_users_own_recordings_are_fitted_in_their_first_half_and_judged_in_their_second() {
    let bench = simulated();
    let set = set(&bench, "rig5");
    let material = Material::halves(&set).unwrap();
    let halves = material.fit.trials.iter().zip(&material.held_out.trials);
    for (first, second) in halves {
        let durations = [first.duration_s, second.duration_s];
        assert_eq!(durations, [Some(1.0); 2]);
        near(second.start_s - first.start_s, 1.0, 1e-12);
        assert_eq!(first.file, second.file);
    }
    assert!(material.fit.is_simulated() && material.held_out.is_simulated());
}

#[test]
fn takes_of_something_else_are_refused_and_so_is_what_is_not_there() {
    let bench = simulated();
    let mut others = set(&bench, "rig6");
    for trial in &mut others.trials {
        trial.speed_mm_s += 1.0;
    }
    let refusal = Material::takes(set(&bench, "rig5"), others).unwrap_err();
    assert!(refusal.to_string().contains("same trials"), "{refusal}");
    holds(&bench.refuse("frontier --data nowhere --out out"), &["nowhere"]);
    holds(&bench.fail("frontier --data rig5 --orders 500"), &["1 to 400"]);
}
