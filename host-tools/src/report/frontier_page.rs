//! The comparison as a page: pictures, tables, and what every figure is.

use std::path::Path;

use stylus_costs::Origin;
use stylus_kernel::direct::{NEAR_TAPS, TAPS_PER_TURN};

use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::frontier::{
    CLOCKS_HZ, Change, Earlier, Filter, FilterStructure, Frontier, INTERVALS, PARTS_COLUMNS,
    PartsRow, Place, Point, interval_ms, moving, share,
};
use crate::fit::Order;
use crate::report::html::{Column, Page};
use crate::report::plot::{
    COST, Caption, FrontAxis, FrontLine, FrontLook, FrontPoint, FrontSeries, Quantity, Svg,
    front_chart,
};
use crate::support::error::Result;

/// The interval that a device has, samples.
const DEVICE_INTERVAL: usize = stylus_kernel::UPDATE_INTERVAL_SAMPLES as usize;

/// The page's pictures.
pub struct Pictures {
    /// C against cycles.
    pub cost: Svg,
    /// SNR against cycles.
    pub snr: Svg,
    /// The error at rest and in motion against cycles, updates included.
    pub total: Svg,
    /// The error in motion by the interval of updates.
    pub intervals: Svg,
}

/// Draws them, with the front of an earlier comparison where there is one.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn pictures(frontier: &Frontier, before: Option<&Earlier>) -> Result<Pictures> {
    let caption = |title| Caption {
        title,
        simulated: frontier.simulated,
    };
    let cycles = FrontAxis::octaves(Quantity::new("cycles per sample (Cortex-M4, modelled)", ""));
    let with_updates = FrontAxis::octaves(Quantity::new(
        "cycles per sample, updates included (Cortex-M4, modelled)",
        "",
    ));
    let from_zero = |name, unit| FrontAxis::from_zero(Quantity::new(name, unit));
    let by_order = |y: fn(&Filter) -> f64| {
        series(|structure| {
            let filters = frontier.filters.iter().filter(|f| f.structure == structure);
            let points = filters.map(|filter| FrontPoint {
                x: filter.m4.sample.cycles,
                y: y(filter),
                joined: matches!(filter.order, Order::Fixed(_)),
            });
            points.collect()
        })
    };
    let total = series(|structure| {
        let points = frontier.points.iter().filter_map(|point| {
            let filter = &frontier.filters[point.filter];
            let joined =
                point.interval == DEVICE_INTERVAL && matches!(filter.order, Order::Fixed(_));
            let shown = joined || point.on_front || point.on_safe_front;
            (filter.structure == structure && shown).then_some(FrontPoint {
                x: point.cycles,
                y: point.total_error_db,
                joined,
            })
        });
        points.collect()
    });
    let intervals = series(|structure| {
        let points = frontier.points.iter().filter(|point| {
            let filter = &frontier.filters[point.filter];
            filter.structure == structure && filter.order == Order::Auto
        });
        let points = points.map(|point| FrontPoint {
            x: point.interval_ms(),
            y: point.motion_error_db,
            joined: true,
        });
        points.collect()
    });
    Ok(Pictures {
        cost: front_chart(
            &caption("Cost C at rest against time, by order"),
            (cycles, FrontAxis::from_zero(COST)),
            &by_order(|filter| 100.0 * filter.still.cost),
            &[cost_front(frontier)],
        )?,
        snr: front_chart(
            &caption("Noise of the arithmetic against time, by order"),
            (cycles, from_zero("SNR of the noisiest node", "dB")),
            &by_order(|filter| filter.still.lowest_snr_db),
            &[],
        )?,
        total: front_chart(
            &caption("Error in third-octave bands, at rest and in motion, against time"),
            (with_updates, from_zero("RMS error", "dB")),
            &total,
            &fronts(frontier, before),
        )?,
        intervals: front_chart(
            &caption("Error in motion by the interval of updates, order per node by AIC"),
            (
                from_zero("from update to update", "ms"),
                from_zero("RMS error", "dB"),
            ),
            &intervals,
            &[],
        )?,
    })
}

/// The fronts of all choices and of those that hold every hard case, and the latter of an earlier comparison.
fn fronts(frontier: &Frontier, before: Option<&Earlier>) -> Vec<FrontLine> {
    let line = |name: &str, look, is_on: fn(&Point) -> bool| {
        let on = frontier.points.iter().filter(|point| is_on(point));
        let points = on.map(|point| {
            let order = short_order(&frontier.filters[point.filter]);
            let label = format!("{order} @ {}", point.interval_ms());
            (point.cycles, point.total_error_db, label)
        });
        FrontLine {
            name: name.to_owned(),
            look,
            points: by_cycles(points.collect()),
        }
    };
    let mut fronts = vec![
        line("front of all", FrontLook::Ringed, |point| point.on_front),
        line(
            "front of what holds every hard case",
            FrontLook::Squared,
            |point| point.on_safe_front,
        ),
    ];
    fronts.extend(before.map(|before| {
        let places = before.safe_front().into_iter();
        FrontLine {
            name: "the front before, of what holds every hard case".to_owned(),
            look: FrontLook::Faded,
            points: places.map(|(x, y)| (x, y, String::new())).collect(),
        }
    }));
    fronts
}

/// The front of C at rest.
fn cost_front(frontier: &Frontier) -> FrontLine {
    let on = frontier
        .filters
        .iter()
        .filter(|filter| filter.on_cost_front);
    let points = on.map(|filter| {
        let cycles = filter.m4.sample.cycles;
        (cycles, 100.0 * filter.still.cost, short_order(filter))
    });
    FrontLine {
        name: "front of all".to_owned(),
        look: FrontLook::Ringed,
        points: by_cycles(points.collect()),
    }
}

fn by_cycles(mut points: Vec<(f64, f64, String)>) -> Vec<(f64, f64, String)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

fn series(points: impl Fn(FilterStructure) -> Vec<FrontPoint>) -> Vec<FrontSeries> {
    FilterStructure::ALL
        .into_iter()
        .map(|structure| FrontSeries {
            name: structure.to_string(),
            points: points(structure),
            dashed: !structure.is_shipped(),
        })
        .collect()
}

/// The orders that are the same for all nodes, in words.
fn orders_in_words(frontier: &Frontier) -> String {
    let mut orders: Vec<usize> = frontier
        .filters
        .iter()
        .filter_map(|filter| match filter.order {
            Order::Fixed(order) => Some(order),
            _ => None,
        })
        .collect();
    orders.sort_unstable();
    orders.dedup();
    let words: Vec<String> = orders.iter().map(ToString::to_string).collect();
    match words.split_last() {
        None => "no orders".to_owned(),
        Some((only, [])) => format!("order {only}"),
        Some((last, before)) => format!("orders {} and {last}", before.join(", ")),
    }
}

fn short_order(filter: &Filter) -> String {
    match filter.order {
        Order::Fixed(order) => order.to_string(),
        Order::Bayesian => "BIC".to_owned(),
        Order::Auto | Order::AtMost(_) => "AIC".to_owned(),
    }
}

/// Writes the page, with an earlier comparison's front beside this one's where there is one.
///
/// # Errors
/// A picture that cannot be laid out, or a file that cannot be written.
pub fn write(
    frontier: &Frontier,
    before: Option<&Earlier>,
    pictures: &Pictures,
    path: &Path,
) -> Result<()> {
    let mut page = Page::new("What accuracy costs in time");
    page.paragraph(&format!(
        "Structures by orders by intervals of updates: how near each comes, and what it costs on a Cortex-M4. {} \
         nodes of {}. {}.",
        frontier.nodes,
        frontier.textures.join(", "),
        capitalised(&frontier.material)
    ));
    if frontier.simulated {
        page.notice(
            "The recordings are SIMULATED. The figures tell how the choices compare on them, not how near any of them \
             comes to a surface.",
        );
    }
    page.paragraph(&format!(
        "Made by stylus frontier; instructions and cycles by cargo tasks costs with rustc {} and QEMU {}. \
         Instructions are counted and exact for that compiler. Cycles are llvm-mca's model (LLVM {}) of each core, \
         without wait states, and not true to the cycle. The fronts go by those of the Cortex-M4.",
        frontier.rustc, frontier.qemu, frontier.llvm_mca
    ));
    page.section("Errors against time")
        .figure(
            &pictures.total,
            &format!(
                "Error at rest and in motion together against the time of a sample and its share of the updates. \
                 Coloured lines join {} at the stylus's own interval of {} ms; dashed structures are not shipped. The \
                 steps are the fronts over all orders and intervals, each choice with its order @ its interval in ms.\
                 {}",
                orders_in_words(frontier),
                interval_ms(DEVICE_INTERVAL),
                if before.is_some() {
                    " Grey is the front before."
                } else {
                    ""
                }
            ),
        )
        .figure(
            &pictures.cost,
            &format!(
                "The paper's cost C against recordings that were held out. Coloured lines join {}; points beside are \
                 orders chosen per node. The steps are the front, each choice with its order.",
                orders_in_words(frontier)
            ),
        )
        .figure(
            &pictures.snr,
            "Signal to noise against float64 with the stored coefficients, of the noisiest node.",
        )
        .figure(
            &pictures.intervals,
            "What is lost by following the hand only every so often. A direct form interpolates its predictor \
             coefficients, the reference θ: that difference remains at every interval.",
        );
    page.paragraph(&format!(
        "For comparison, one take against the other, with no model between them: C {:.1} %, bands {:.2} dB. No model \
         of noise comes nearer than that but by chance.",
        100.0 * frontier.take_cost,
        frontier.take_band_error_db
    ));
    front_table(&mut page, frontier);
    if let Some(before) = before {
        change_table(&mut page, &before.changes(frontier));
    }
    filter_table(&mut page, frontier);
    time_table(&mut page, frontier);
    interval_table(&mut page, frontier);
    peer_table(&mut page, frontier);
    parts_table(&mut page, frontier);
    page.section("What the figures are").list(&notes(frontier));
    page.write(path)
}

fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(characters).collect()
}

fn front_table(page: &mut Page, frontier: &Frontier) {
    let on_a_front = |point: &&Point| point.on_front || point.on_safe_front;
    let mut points: Vec<&Point> = frontier.points.iter().filter(on_a_front).collect();
    points.sort_by(|a, b| a.cycles.total_cmp(&b.cycles));
    let rows: Vec<Vec<String>> = points
        .into_iter()
        .map(|point| {
            let filter = &frontier.filters[point.filter];
            let mut row = vec![
                filter.structure.to_string(),
                filter.order_text(),
                format!("{}", point.interval_ms()),
                format!("{:.2}", point.total_error_db),
                format!("{:.2}", filter.still.band_error_db),
                format!("{:.2}", point.motion_error_db),
                format!("{:.0}", point.cycles),
            ];
            row.extend(point.shares().map(percent));
            row.push(format!("{} of {}", filter.hard.held, filter.hard.cases));
            row.push(
                match (point.on_front, point.on_safe_front) {
                    (true, true) => "both",
                    (true, false) => "all",
                    (false, _) => "safe",
                }
                .to_owned(),
            );
            row
        })
        .collect();
    let clocks = clock_headings();
    let mut columns = vec![
        Column::Text("structure"),
        Column::Text("order"),
        Column::Number("update, ms"),
        Column::Number("error, dB"),
        Column::Number("at rest"),
        Column::Number("in motion"),
        Column::Number("cycles"),
    ];
    columns.extend(clocks.iter().map(|clock| Column::Number(clock)));
    columns.push(Column::Text("hard cases held"));
    columns.push(Column::Text("front of"));
    page.section("The Pareto front").table(
        "Nothing cheaper has a lower error, all textures being held; safe: among what holds every hard case; shares \
         are of 200 µs",
        &columns,
        &rows,
    );
}

fn change_table(page: &mut Page, changes: &[Change]) {
    let error = |place: Option<Place>| match place {
        Some(place) if place.error_db.is_finite() => format!("{:.2}", place.error_db),
        _ => String::new(),
    };
    let cycles = |place: Option<Place>| match place {
        Some(place) => format!("{:.0}", place.cycles),
        None => String::new(),
    };
    let ratio = |change: &Change| match (change.before, change.now) {
        (Some(before), Some(now)) => format!("{:.2}", now.cycles / before.cycles),
        _ => String::new(),
    };
    let front = |place: Option<Place>| match place {
        Some(place) if place.on_front && place.on_safe_front => "both",
        Some(place) if place.on_front => "all",
        Some(place) if place.on_safe_front => "safe",
        _ => "",
    };
    let rows = changes.iter().map(|change| {
        let (before, now) = (front(change.before), front(change.now));
        let is_what = match (before, now) {
            ("", _) => "new",
            (_, "") => "gone",
            _ => "stays",
        };
        vec![
            change.structure.name().to_owned(),
            change.order.clone(),
            interval_ms(change.interval).to_string(),
            cycles(change.before),
            cycles(change.now),
            ratio(change),
            error(change.before),
            error(change.now),
            before.to_owned(),
            now.to_owned(),
            is_what.to_owned(),
        ]
    });
    page.section("The front before and now").table(
        "Choices on a front of this comparison or of the one before, with the cycles of a sample, updates \
         included; both, all and safe as above",
        &[
            Column::Text("structure"),
            Column::Text("order"),
            Column::Number("update, ms"),
            Column::Number("cycles before"),
            Column::Number("now"),
            Column::Number("now / before"),
            Column::Number("error before, dB"),
            Column::Number("now"),
            Column::Text("front before"),
            Column::Text("now"),
            Column::Text("the choice"),
        ],
        &rows.collect::<Vec<_>>(),
    );
}

fn parts_table(page: &mut Page, frontier: &Frontier) {
    let columns: Vec<Column<'_>> = PARTS_COLUMNS
        .iter()
        .map(|&(heading, is_number)| {
            if is_number {
                Column::Number(heading)
            } else {
                Column::Text(heading)
            }
        })
        .collect();
    let rows: Vec<Vec<String>> = frontier.parts.iter().map(PartsRow::cells).collect();
    page.section("Excitation, level and lines")
        .paragraph(
            "What no spectrum shows: the optional parts of a texture, played by the normalised lattice at the highest \
             order, at rest, against the held-out recordings. Distances are medians over nodes: |log2| of the ratio of \
             kurtosis, dB of modulation and of the spread of 50 ms levels. Instructions of the tick are the device's \
             own count, at most; those of the update make the excitation ahead of the tick.",
        )
        .table(
            "Parts: what they cost and what they bring",
            &columns,
            &rows,
        );
    if frontier.parts.len() == 1 {
        page.paragraph("No texture of these recordings has such a part: nothing to choose.");
    }
}

fn clock_headings() -> [String; 3] {
    CLOCKS_HZ.map(|clock_hz| format!("{} MHz", clock_hz / 1e6))
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn filter_table(page: &mut Page, frontier: &Frontier) {
    let rows: Vec<Vec<String>> = frontier
        .filters
        .iter()
        .map(|filter| {
            let still = &filter.still;
            let refused = match (still.refused, filter.refused_textures.as_slice()) {
                (0, []) => String::new(),
                (0, textures) => textures.join(", "),
                (nodes, _) => format!("{nodes} nodes"),
            };
            let worst = match filter.hard.worst_case.as_str() {
                "" => filter.hard.worst.to_string(),
                case => format!("{}: {case}", filter.hard.worst),
            };
            vec![
                filter.structure.to_string(),
                filter.order_text(),
                format!("{:.1}", 100.0 * still.cost),
                format!("{:.2}", still.band_error_db),
                format!("{:.0} %", 100.0 * still.bands_within_jnd),
                format!("{:.0}", still.lowest_snr_db),
                format!("{:.0}", still.mean_snr_db),
                refused,
                format!("{} of {}", filter.hard.held, filter.hard.cases),
                worst,
                (if filter.on_cost_front { "yes" } else { "" }).to_owned(),
            ]
        })
        .collect();
    let within = format!("within {AMPLITUDE_JND_DB} dB");
    page.section("Accuracy at rest, and the hard cases").table(
        "Each structure at each order",
        &[
            Column::Text("structure"),
            Column::Text("order"),
            Column::Number("C, %"),
            Column::Number("bands, dB"),
            Column::Number(&within),
            Column::Number("SNR, dB, lowest"),
            Column::Number("mean"),
            Column::Text("refused by fit"),
            Column::Text("hard cases held"),
            Column::Text("the worst"),
            Column::Text("on the front of C"),
        ],
        &rows,
    );
}

fn time_table(page: &mut Page, frontier: &Frontier) {
    let rows: Vec<Vec<String>> = frontier
        .filters
        .iter()
        .map(|filter| {
            let (m4, m7) = (&filter.m4, &filter.m7);
            let mut row = vec![
                filter.structure.to_string(),
                filter.order_text(),
                format!("{:.0}", m4.sample.instructions),
                format!("{:.0}", m7.sample.instructions),
                format!("{:.0}", m4.sample.cycles),
            ];
            row.extend(CLOCKS_HZ.map(|clock| percent(share(m4.sample.cycles, clock))));
            row.extend([
                format!("{:.0}", m7.sample.cycles),
                format!(
                    "{:.0} to {:.0}",
                    m4.update.instructions_least, m4.update.instructions_most
                ),
                filter.library_bytes_per_node.to_string(),
                filter.ram_bytes.to_string(),
            ]);
            row
        })
        .collect();
    let clocks = clock_headings();
    let mut columns = vec![
        Column::Text("structure"),
        Column::Text("order"),
        Column::Number("instructions, M4"),
        Column::Number("M7"),
        Column::Number("cycles"),
    ];
    columns.extend(clocks.iter().map(|clock| Column::Number(clock)));
    columns.extend([
        Column::Number("cycles, M7"),
        Column::Number("an update, instructions"),
        Column::Number("flash, bytes per node"),
        Column::Number("RAM, bytes"),
    ]);
    page.section("Time and memory").table(
        "A sample, without updates; cycles are llvm-mca's, of an M4 unless they are said to be others, and shares \
         are of 200 µs",
        &columns,
        &rows,
    );
}

fn interval_table(page: &mut Page, frontier: &Frontier) {
    let headings = INTERVALS.map(|interval| format!("{} ms", interval_ms(interval)));
    let mut columns = vec![Column::Text("structure"), Column::Text("order")];
    columns.extend(headings.iter().map(|heading| Column::Number(heading)));
    let rows: Vec<Vec<String>> = frontier
        .filters
        .iter()
        .enumerate()
        .map(|(index, filter)| {
            let points = frontier.points.iter().filter(|point| point.filter == index);
            let mut row = vec![filter.structure.to_string(), filter.order_text()];
            row.extend(points.map(|point| {
                if point.motion_error_db.is_nan() {
                    "refused".to_owned()
                } else {
                    format!("{:.2} / {:.0}", point.motion_error_db, point.cycles)
                }
            }));
            row
        })
        .collect();
    page.section("In motion").table(
        "RMS error in bands, dB / cycles per sample, updates included; 0.2 ms is every sample",
        &columns,
        &rows,
    );
}

fn peer_table(page: &mut Page, frontier: &Frontier) {
    let cycles = |cycles: Option<u32>| cycles.map_or("-".to_owned(), |c| c.to_string());
    let rows: Vec<Vec<String>> = frontier
        .peers
        .iter()
        .map(|peer| {
            vec![
                peer.name.clone(),
                peer.order.to_string(),
                peer.instructions.to_string(),
                cycles(peer.cortex_m4_cycles),
                cycles(peer.cortex_m7_cycles),
                peer.includes.clone(),
                match peer.origin {
                    Origin::Measured => "counted in this run",
                    Origin::Reference => "reference, by the same rules",
                }
                .to_owned(),
            ]
        })
        .collect();
    if rows.is_empty() {
        return;
    }
    page.section("Beside others").table(
        "One sample per call; cycles are llvm-mca's",
        &[
            Column::Text("what"),
            Column::Number("order"),
            Column::Number("instructions"),
            Column::Number("cycles, M4"),
            Column::Number("M7"),
            Column::Text("beside the filter"),
            Column::Text("origin"),
        ],
        &rows,
    );
}

fn notes(frontier: &Frontier) -> Vec<String> {
    vec![
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
        "The error of a choice is √(at rest² + in motion²). What gains less than 0.05 dB, or 0.5 % of C, is on no \
         front.".to_owned(),
        "Orders per node, with the highest of all: by Akaike's criterion (AIC), as fit chooses, or by the Bayesian \
         one (BIC), as fit --order bic does. SNR is of the output, in steps of 2⁻²⁰ m/s²: quiet nodes have \
         less."
            .to_owned(),
        "The hard cases are those of stylus stress (short), their models cut to the order. Held means all that is \
         promised of the stylus's lattice, 108 dB of SNR included. Worse and worse: never quite silent, inaccurate, \
         saturates, refused by fit, latches."
            .to_owned(),
        "Refused by fit are textures whose direct form is unstable between its nodes; such a choice is on no front of \
         motion, and its error there is that of the other textures."
            .to_owned(),
        format!(
            "Between measured orders instructions and cycles are on a straight line; a direct form's are those of the \
             next multiple of {TAPS_PER_TURN} taps beyond {NEAR_TAPS}. Per node, the time is that of the highest \
             order: a texture's tick takes the same time wherever the hand is."
        ),
        "Time with updates: updates that stay in a cell take the share of the dearest that their \
         instructions are. Updates run below the sample's priority; only the sample has to be done in 200 µs."
            .to_owned(),
        "Flash is a node's coefficients in a library. RAM is the coefficients of two frames and the state, at that \
         order."
            .to_owned(),
        "The variants that are not shipped (two-multiplier lattice, 16-bit lattice) are plain Rust as compiled; what \
         is shipped has its inner loops laid out by hand."
            .to_owned(),
    ]
}
