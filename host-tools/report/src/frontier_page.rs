//! The comparison of accuracy and computing time as a page: pictures, tables, and explanations of the figures.

use std::path::Path;

use stylus_costs::Origin;
use stylus_dsp::spectrum::AMPLITUDE_JND_DB;
use stylus_evaluation::frontier::{
    CHOICES_NOTE, CLOCKS_HZ, Filter, Frontier, Point, Structure, clock_headings, interval_ms, moving, share,
};
use stylus_evaluation::table::{Table, percent};
use stylus_fit::fit::Order;
use stylus_support::Result;

use crate::html::Page;
use crate::plot::{Caption, FrontPoint, FrontSeries, Quantity, Svg, front_chart};

/// Interval of updates on a device, samples.
const DEVICE_INTERVAL: usize = stylus_kernel::UPDATE_INTERVAL_SAMPLES as usize;

/// Quantity of the cycles along a picture's horizontal axis.
const CYCLES: Quantity = Quantity::new("cycles per sample, Cortex-M7, modelled", "");

/// Quantity of the errors along a picture's vertical axis.
const ERROR: Quantity = Quantity::new("RMS error", "dB");

/// Writes the page.
pub fn write(frontier: &Frontier, path: &Path) -> Result<()> {
    let mut page = Page::new("What accuracy costs in time");
    if frontier.simulated {
        page.notice(
            "The recordings are SIMULATED. The figures tell how the choices compare on them, not how near any of them \
             comes to a surface.",
        );
    }
    page.paragraph(&frontier.answer()).table(&frontier.choice_table());
    let (answer, of_answer) = time_picture(frontier)?;
    let (intervals, of_intervals) = interval_picture(frontier)?;
    page.paragraph(CHOICES_NOTE).figure(&answer, &of_answer, &[]);
    page.folded("Error in motion by the interval of updates", |page| {
        page.figure(&intervals, &of_intervals, &[]);
    });
    page.folded("The Pareto front", |page| {
        page.table(&frontier.front_table());
    });
    page.folded("Every structure at each order", |page| {
        page.table(&filter_table(frontier));
    });
    if !frontier.peers.is_empty() {
        page.folded("Beside filters of other libraries", |page| {
            page.table(&peer_table(frontier));
        });
    }
    page.folded("What the figures are", |page| {
        page.list(&notes(frontier));
    });
    page.write(path)
}

/// Draws the total error, at rest and in motion, against time. Returns the picture and its caption.
fn time_picture(frontier: &Frontier) -> Result<(Svg, String)> {
    let is_fixed = |filter: &Filter| matches!(filter.order, Order::Fixed(_));
    let point = |point: &Point| FrontPoint {
        x: point.cycles,
        y: point.total_error_db,
        name: format!(
            "order {} @ {} ms",
            frontier.filters[point.filter].order_text(),
            point.interval_ms()
        ),
    };
    let total = series(|structure| {
        let own = points_of(frontier, structure).filter(|own| {
            // A choice with an order per node has no place on a line of orders.
            own.interval == DEVICE_INTERVAL && is_fixed(&frontier.filters[own.filter])
        });
        own.map(&point).collect()
    });
    let names = ["front of all", "front of what holds every hard case"];
    let on_front = frontier.front().into_iter().map(point);
    let front = FrontSeries {
        name: names[usize::from(frontier.is_safe())].to_owned(),
        points: on_front.collect(),
        dashed: false,
    };
    let choices: Vec<(&str, f64, f64)> = frontier
        .choices()
        .into_iter()
        .map(|(name, choice)| (name, choice.cycles, choice.total_error_db))
        .collect();
    let title = "Error in third-octave bands, at rest and in motion, against time";
    let caption = Caption::new(title, frontier.simulated);
    let picture = front_chart(&caption, (CYCLES, ERROR), true, (&total, &[front]), &choices)?;
    let words = format!(
        "Error at rest and in motion together against the time of a sample and its share of the updates. Coloured \
         lines join orders at the stylus's own interval of {} ms; dashed structures are not shipped. The steps are \
         the front over all orders and intervals; point at or tap a choice to read it.",
        interval_ms(DEVICE_INTERVAL)
    );
    Ok((picture, words))
}

/// Draws the error in motion against the interval of updates. Returns the picture and its caption.
fn interval_picture(frontier: &Frontier) -> Result<(Svg, String)> {
    let intervals = series(|structure| {
        points_of(frontier, structure)
            .filter(|point| frontier.filters[point.filter].order == Order::Auto)
            .map(|point| FrontPoint {
                x: point.interval_ms(),
                y: point.motion_error_db,
                name: String::new(),
            })
            .collect()
    });
    let ms = Quantity::new("from update to update", "ms");
    let title = "Error in motion by the interval of updates, order per node as fit chooses";
    let caption = Caption::new(title, frontier.simulated);
    let picture = front_chart(&caption, (ms, ERROR), false, (&intervals, &[]), &[])?;
    let words = "What is lost by following the hand only every so often. A direct form interpolates its predictor \
                 coefficients, the reference θ: that difference remains at every interval.";
    Ok((picture, words.to_owned()))
}

fn points_of(frontier: &Frontier, structure: Structure) -> impl Iterator<Item = &Point> {
    frontier
        .points
        .iter()
        .filter(move |point| frontier.filters[point.filter].structure == structure)
}

fn series(points: impl Fn(Structure) -> Vec<FrontPoint>) -> Vec<FrontSeries> {
    Structure::ALL
        .into_iter()
        .map(|structure| FrontSeries {
            name: structure.to_string(),
            points: points(structure),
            dashed: structure.is_direct(),
        })
        .collect()
}

fn filter_table(frontier: &Frontier) -> Table {
    let row = |filter: &Filter| {
        let (still, m4, m7) = (&filter.still, &filter.m4, &filter.m7);
        let refused = match (still.refused, filter.refused_textures.as_slice()) {
            (0, textures) => textures.join(", "),
            (nodes, _) => format!("{nodes} nodes"),
        };
        let worst = match filter.hard.worst_case.as_str() {
            "" => filter.hard.worst.to_string(),
            case => format!("{}: {case}", filter.hard.worst),
        };
        let cell = |heading: &str, text: String| (heading.to_owned(), text);
        let within = format!("within {AMPLITUDE_JND_DB} dB, %");
        let mut row = vec![
            cell("structure", filter.structure.to_string()),
            cell("order", filter.order_text()),
            cell("C, %", percent(Some(still.cost), 1)),
            cell("bands, dB", format!("{:.2}", still.band_error_db)),
            (within, percent(Some(still.bands_within_jnd), 0)),
            cell("SNR, dB, lowest", format!("{:.0}", still.lowest_snr_db)),
            cell("refused by fit", refused),
            cell("hard cases held", filter.hard.to_string()),
            cell("the worst", worst),
            cell("instructions, M4", format!("{:.0}", m4.sample.instructions)),
            cell("M7", format!("{:.0}", m7.sample.instructions)),
            cell("cycles", format!("{:.0}", m4.sample.cycles)),
        ];
        let shares = CLOCKS_HZ.map(|clock| percent(Some(share(m4.sample.cycles, clock)), 1));
        row.extend(clock_headings().into_iter().zip(shares));
        let update = format!("{:.0}", m4.update.instructions_most);
        row.extend([
            cell("cycles, M7", format!("{:.0}", m7.sample.cycles)),
            cell("an update, instructions", update),
            cell("flash, bytes per node", filter.library_bytes_per_node.to_string()),
            cell("RAM, bytes", filter.ram_bytes.to_string()),
        ]);
        row
    };
    Table::headed(
        "Accuracy at rest, the hard cases, and a sample's time without updates: cycles are llvm-mca's, of an M4 \
         unless they are said to be others, and shares are of 200 µs",
        frontier.filters.iter().map(row),
    )
}

fn peer_table(frontier: &Frontier) -> Table {
    let cycles = |cycles: Option<u32>| cycles.map_or("-".to_owned(), |c| c.to_string());
    let rows = frontier.peers.iter().map(|peer| {
        let origin = match peer.origin {
            Origin::Measured => "counted in this run",
            Origin::Reference => "reference, by the same rules",
        };
        vec![
            ("what", peer.name.clone()),
            ("order", peer.order.to_string()),
            ("instructions", peer.instructions.to_string()),
            ("cycles, M4", cycles(peer.cortex_m4_cycles)),
            ("M7", cycles(peer.cortex_m7_cycles)),
            ("beside the filter", peer.includes.clone()),
            ("origin", origin.to_owned()),
        ]
    });
    Table::headed("One sample per call; cycles are llvm-mca's", rows)
}

fn notes(frontier: &Frontier) -> Vec<String> {
    vec![
        format!(
            "{} nodes of {}. Material: {}.",
            frontier.nodes,
            frontier.textures.join(", "),
            frontier.material
        ),
        format!(
            "Made by stylus frontier; instructions and cycles were counted with rustc {} and QEMU {}. \
             Instructions are counted and exact for that compiler. Cycles are llvm-mca's model (LLVM {}) of each \
             core, without wait states, and not true to the cycle. The fronts go by those of the Cortex-M7.",
            frontier.rustc, frontier.qemu, frontier.llvm_mca
        ),
        format!(
            "One take against the other, with no model between them: C {:.1} %, bands {:.2} dB. No model of noise \
             comes nearer than that but by chance.",
            100.0 * frontier.take_cost,
            frontier.take_band_error_db
        ),
        format!(
            "At rest: each node's model plays at its own speed and force, by the kernel or a variant, and is compared \
             with the recording that was held out. C is the paper's equation (6), amplitudes smoothed by a {}. Bands \
             are third octaves from 20 to 1000 Hz.",
            frontier.smoothing
        ),
        format!(
            "In motion: a hand rubs over the whole grid, twice a second to and fro. Against the same noise through a \
             normalised lattice in float64, updated at every sample, of the same order; levels in bands in frames of \
             {} s.",
            moving::FRAME_S
        ),
        "The error of a choice is √(at rest² + in motion²). What gains less than 0.05 dB is on no front.".to_owned(),
        "Orders per node, with the highest of all: as fit chooses (auto), or by the Bayesian criterion (BIC), as fit \
         --order bic does. SNR is of the output, in steps of 2⁻²⁰ m/s²: quiet nodes have less."
            .to_owned(),
        "The hard cases are those of stylus stress (short), by its names, their models cut to the order. Held means \
         all that is promised of the stylus's lattice, 108 dB of SNR included. Worse and worse: never quite silent, \
         inaccurate, saturates, refused, latches."
            .to_owned(),
        "Refused are textures whose coefficients a direct form's words cannot hold; such a choice is on no front of \
         motion, and its error there is that of the other textures. A direct form may be unstable between its nodes; \
         it then saturates, and its error in motion shows it."
            .to_owned(),
        "Between measured orders instructions and cycles are on a straight line. Per node, the time is that of the \
         highest order: a texture's tick takes the same time wherever the hand is."
            .to_owned(),
        "Time with updates: updates that stay in a cell take the share of the dearest that their \
         instructions are. Updates run below the sample's priority; only the sample has to be done in 200 µs."
            .to_owned(),
        "Flash is a node's coefficients in a library. RAM is the coefficients of two frames and the state, at that \
         order."
            .to_owned(),
        "The direct forms are plain Rust as compiled; the lattice of the stylus has its inner loops laid out \
         by hand."
            .to_owned(),
    ]
}
