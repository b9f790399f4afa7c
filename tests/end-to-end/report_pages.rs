//! The pages of `report`, `evaluate --report` and `frontier`: one unit and one scale, sounds and anchors, and in a
//! browser what a reader sees on narrow and wide windows, in light and dark.

use std::collections::BTreeMap;
use std::path::Path;

use crate::support::browser::Browser;
use crate::support::{Bench, RATE_HZ, noise, rig_of, wav};
use host_tools::evaluation::frontier::Frontier;
use serde_json::Value;

/// The committed comparison.
const NUMBERS: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../host-tools/frontier/frontier.json"
);

/// Simulated recordings of two textures, one much louder than the other, and their library.
fn fitted() -> Bench {
    let bench = Bench::new();
    let rig = rig_of("60, 120, 240", "0.4, 0.8, 1.2");
    let is_chosen = |part: &&str| !part.contains("\"organza\"") && !part.contains("\"vinyl\"");
    let chosen: Vec<&str> = rig.split("[[texture]]").filter(is_chosen).collect();
    bench.write("rig.toml", chosen.join("[[texture]]"));
    bench.succeed("simulate-rig --rig rig.toml --out set");
    bench.succeed("fit set --out a.lib --order 30");
    bench
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

/// The texts of elements that begin with `<tag`.
fn texts_of(page: &str, tag: &str) -> Vec<String> {
    let begin = format!("<{tag}");
    let pieces = page.split(&begin).skip(1);
    pieces
        .filter_map(|piece| piece.split_once('>'))
        .map(|(_, rest)| rest.split('<').next().unwrap().trim().to_owned())
        .collect()
}

/// The pictures of a page whose heading contains `word`.
fn pictures<'a>(page: &'a str, word: &str) -> Vec<&'a str> {
    let all = page.split("<svg ").skip(1);
    let all = all.map(|svg| svg.split("</svg>").next().unwrap());
    all.filter(|svg| {
        let (_, name) = svg.split_once("aria-label=\"").unwrap();
        name.split('"').next().unwrap().contains(word)
    })
    .collect()
}

fn check_page(page: &str) {
    // Zero has no sign, and an order is no sample size.
    for text in texts_of(page, "td")
        .into_iter()
        .chain(texts_of(page, "text"))
    {
        let is_zero = text.parse::<f64>().is_ok_and(|value| value == 0.0);
        assert!(!(is_zero && text.starts_with('-')), "{text}");
        assert!(!text.contains("n = "), "{text}");
    }
    // C is in per cent: no heading or axis names it without.
    let headings = texts_of(page, "th").into_iter();
    for heading in headings.chain(texts_of(page, "text")) {
        let is_cost = heading == "C" || heading == "cost C" || heading.starts_with("mean C");
        assert!(!is_cost || heading.ends_with('%'), "{heading}");
        assert_ne!(heading, "C (%)");
    }
    // All anchors resolve, and none twice.
    let links: Vec<&str> = page.split("href=\"#").skip(1).collect();
    assert!(links.len() >= 3);
    for link in links {
        let anchor = link.split('"').next().unwrap();
        assert_eq!(
            page.matches(&format!("id=\"{anchor}\"")).count(),
            1,
            "{anchor}"
        );
    }
    for outside in [
        "http://",
        "https://",
        "url(",
        "src=\"http",
        "fetch(",
        "XMLHttpRequest",
    ] {
        let page = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!page.contains(outside), "{outside}");
    }
}

#[test]
fn an_evaluations_page_has_sounds_contents_and_one_scale_for_the_maps_of_all_textures() {
    let bench = fitted();
    bench.succeed("evaluate set --library a.lib --report folder");
    let page = read(&bench.path("folder/index.html"));
    check_page(&page);
    // A recording and a synthesis of each texture, as WAV files in the page.
    assert_eq!(page.matches("<audio controls").count(), 4);
    assert_eq!(page.matches("src=\"data:audio/wav;base64,").count(), 4);
    for what in ["recorded", "synthesised"] {
        assert!(
            page.contains(&format!("denim, 120 mm/s, 0.8 N: {what} (SIMULATED)")),
            "{what}"
        );
    }
    assert!(page.len() < 4_000_000, "{}", page.len());
    // Recording and synthesis of every node, in the order of the recordings' list.
    let nodes = page.split("id=\"nodes\">").nth(1).unwrap();
    let nodes: Value = serde_json::from_str(nodes.split("</script>").next().unwrap()).unwrap();
    for texture in ["paper", "denim"] {
        let own = &nodes["textures"][texture];
        assert_eq!(own["nodes"].as_array().unwrap().len(), 9);
        assert!(
            own["nodes"]
                .as_array()
                .unwrap()
                .contains(&serde_json::json!([120.0, 0.8]))
        );
        let clips = own["clips"].as_array().unwrap();
        assert_eq!(clips.len(), 9);
        for clip in clips.iter().flat_map(|pair| pair.as_array().unwrap()) {
            // Half a second at least, of 5 kHz in 16 bits, in base64.
            assert!(clip.as_str().unwrap().len() > 5000 * 4 / 3);
        }
    }
    let maps = pictures(&page, "C over the grid");
    assert_eq!(maps.len(), 2);
    // The bar's numbers are the last three texts before the quantity.
    let bars = maps.iter().map(|svg| {
        let texts = texts_of(svg, "text");
        assert_eq!(texts.last().unwrap(), "cost C, %");
        texts[texts.len() - 4..].to_vec()
    });
    let bars: Vec<Vec<String>> = bars.collect();
    assert_eq!(bars[0], bars[1]);
}

#[test]
fn a_reports_page_names_the_orders_that_were_asked_for_and_draws_its_spectrograms_to_one_scale() {
    let bench = fitted();
    bench.succeed("report set --library a.lib --order 30 --out page.html");
    let page = read(&bench.path("page.html"));
    check_page(&page);
    assert!(page.contains("denim, 120 mm/s, 0.8 N: order 30"));
    assert!(!page.contains("order 400"));
    let bars: Vec<Vec<String>> = pictures(&page, "120 mm/s")
        .into_iter()
        .filter(|svg| svg.contains("power spectral density"))
        .map(|svg| {
            let texts = texts_of(svg, "text");
            texts[texts.len() - 6..].to_vec()
        })
        .collect();
    assert_eq!(bars.len(), 2);
    assert_eq!(bars[0], bars[1]);
    assert!(
        bars[0].contains(&"dB re 1 (m/s²)²/Hz".to_owned()),
        "{bars:?}"
    );
}

#[test]
fn a_frontiers_page_is_drawn_anew_from_its_numbers_and_what_is_no_such_file_is_refused() {
    let bench = Bench::new();
    bench.succeed(&format!(
        "frontier --redraw {NUMBERS} --before {NUMBERS} --out folder"
    ));
    // The numbers are the same bytes, and the page of the same numbers is the same.
    let numbers = bench.path("folder/frontier.json");
    assert_eq!(
        std::fs::read(&numbers).unwrap(),
        std::fs::read(NUMBERS).unwrap()
    );
    let page = read(&bench.path("folder/index.html"));
    std::fs::remove_file(bench.path("folder/index.html")).unwrap();
    bench.succeed(&format!(
        "frontier --redraw folder/frontier.json --before {NUMBERS}"
    ));
    assert_eq!(read(&bench.path("folder/index.html")), page);
    check_page(&page);
    assert!(!page.contains("No cycle-true model") && page.contains("llvm-mca"));
    // Every choice of a front is labelled in the first picture, and has its row.
    let frontier = Frontier::read(&numbers).unwrap();
    let first = read(&bench.path("folder/error-against-time.svg"));
    let labels = texts_of(&first, "text");
    let labels = labels.iter().filter(|text| text.contains(" @ ")).count();
    let on_front = frontier
        .points
        .iter()
        .filter(|p| p.on_front || p.on_safe_front);
    assert_eq!(labels, on_front.count());
    let orders = "orders 10, 20, 50, 100, 200 and 400";
    assert!(page.contains(orders), "the orders that were compared");
    // A comparison of some of them names no others.
    let mut some = frontier.clone();
    for (index, filter) in some.filters.iter().enumerate() {
        let is_left_out = filter.order == host_tools::fit::Order::Fixed(400);
        some.points
            .retain(|point| point.filter != index || !is_left_out);
    }
    for filter in &mut some.filters {
        if filter.order == host_tools::fit::Order::Fixed(400) {
            filter.order = host_tools::fit::Order::Fixed(200);
        }
    }
    bench.write("some.json", serde_json::to_string(&some).unwrap());
    bench.succeed("frontier --redraw some.json --out some");
    let page = read(&bench.path("some/index.html"));
    assert!(
        page.contains("orders 10, 20, 50, 100 and 200 at"),
        "{}",
        &page[..3000]
    );
    bench.write("other.json", "{}");
    let message = bench.refuse("frontier --redraw other.json");
    assert!(message.contains("other.json") && message.contains("give a frontier.json"));
    let computing = bench.run(&format!("frontier --redraw {NUMBERS} --orders 10"));
    assert!(!computing.status.success());
}

/// Numbers along the vertical axes of each picture of `word`, lowest panel last.
fn scales_of(page: &str, word: &str, axis: &str) -> Vec<Vec<String>> {
    let pictures = pictures(page, word).into_iter();
    let with_axis = pictures.filter(|svg| svg.contains(axis));
    let scales = with_axis.map(|svg| {
        let panels = svg.split("<g class=\"axes\"").skip(1);
        let y = panels.map(|panel| {
            let (_, y) = panel.split_once("data-y=\"").unwrap();
            y.split('"').next().unwrap().to_owned()
        });
        y.collect()
    });
    scales.collect()
}

#[test]
fn pictures_of_textures_that_are_compared_share_their_scales_and_a_small_one_is_drawn_to_its_own_too()
 {
    let bench = fitted();
    bench.succeed("report set --library a.lib --order 30 --out page.html --data data");
    let page = read(&bench.path("page.html"));
    let data = read(&bench.path("data/figures.json"));
    let data: Value = serde_json::from_str(&data).unwrap();
    let figure = |name: &str| {
        let figures = data.as_array().unwrap().iter();
        figures.filter(|figure| figure["name"] == name).count()
    };
    for name in [
        "spectrograms",
        "time-and-frequency",
        "waveforms",
        "bands",
        "prediction",
        "grid",
        "cost-map",
    ] {
        let axes = |texture: &str| {
            let figures = data.as_array().unwrap().iter();
            let named = format!("{texture}-{name}");
            let mut own = figures.filter(|figure| figure["name"] == named.as_str());
            let panels = own.next().unwrap()["panels"].as_array().unwrap().clone();
            let y = panels.iter().map(|panel| panel["y"].clone());
            y.collect::<Vec<Value>>()
        };
        assert_eq!(axes("paper"), axes("denim"), "{name}");
    }
    // Paper is much quieter than denim.
    for name in ["waveforms", "time-and-frequency", "prediction"] {
        assert_eq!(figure(&format!("denim-{name}-own-scale")), 0, "{name}");
    }
    let quiet = scales_of(&page, "paper, 120 mm/s", "smoothed DFT amplitude");
    assert!(quiet.len() >= 2 || figure("paper-time-and-frequency-own-scale") == 0);
}

/// The arrays of an archive of NumPy's, by name, with their shapes. Shares no code with what writes them.
fn arrays(path: &Path) -> BTreeMap<String, (Vec<usize>, Vec<f64>)> {
    let bytes = std::fs::read(path).unwrap();
    let number = |at: usize, len: usize| {
        let part = bytes[at..at + len].iter().rev();
        part.fold(0usize, |sum, byte| (sum << 8) | usize::from(*byte))
    };
    let mut found = BTreeMap::new();
    let mut at = 0;
    while number(at, 4) == 0x0403_4b50 {
        assert_eq!(number(at + 8, 2), 0, "stored, not compressed");
        let (size, name_len) = (number(at + 18, 4), number(at + 26, 2));
        let begin = at + 30 + name_len + number(at + 28, 2);
        let name = String::from_utf8(bytes[at + 30..at + 30 + name_len].to_vec()).unwrap();
        let header_len = number(begin + 8, 2);
        let header =
            String::from_utf8(bytes[begin + 10..begin + 10 + header_len].to_vec()).unwrap();
        assert!(header.contains("'<f8'") && header.contains("'fortran_order': False"));
        let (_, shape) = header.split_once("'shape': (").unwrap();
        let shape = shape.split(')').next().unwrap().split(',');
        let shape: Vec<usize> = shape.filter_map(|len| len.trim().parse().ok()).collect();
        let values = bytes[begin + 10 + header_len..begin + size].chunks_exact(8);
        let values: Vec<f64> = values
            .map(|v| f64::from_le_bytes(v.try_into().unwrap()))
            .collect();
        assert_eq!(shape.iter().product::<usize>(), values.len());
        found.insert(
            name.strip_suffix(".npy").unwrap().to_owned(),
            (shape, values),
        );
        at = begin + size;
    }
    assert_eq!(number(at, 4), 0x0201_4b50, "the directory follows");
    found
}

/// The columns of a CSV file.
fn csv_columns(path: &Path) -> Vec<(String, Vec<Option<f64>>)> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headings = reader.headers().unwrap().clone();
    let mut columns: Vec<(String, Vec<Option<f64>>)> = headings
        .iter()
        .map(|heading| (heading.to_owned(), Vec::new()))
        .collect();
    for record in reader.records() {
        for (column, cell) in columns.iter_mut().zip(&record.unwrap()) {
            column.1.push(cell.parse().ok());
        }
    }
    columns
}

/// Checks that the files of data in a folder agree: each value of an array stands in the CSV file of its figure.
fn check_data(folder: &Path) -> usize {
    let arrays = arrays(&folder.join("figures.npz"));
    let contents: Value = serde_json::from_str(&read(&folder.join("figures.json"))).unwrap();
    let mut seen = 0;
    for figure in contents.as_array().unwrap() {
        let columns = csv_columns(&folder.join(figure["csv"].as_str().unwrap()));
        for panel in figure["panels"].as_array().unwrap() {
            for axis in ["x", "y"] {
                assert!(!panel[axis]["quantity"].as_str().unwrap().is_empty());
            }
            for series in panel["series"].as_array().unwrap() {
                let name = if series["z"].is_null() {
                    &series["y"]
                } else {
                    &series["z"]["array"]
                };
                let (shape, values) = &arrays[name.as_str().unwrap()];
                let (x, y) = (
                    &arrays[series["x"].as_str().unwrap()].1,
                    &arrays[series["y"].as_str().unwrap()].1,
                );
                let is_map = shape.len() == 2;
                assert_eq!(
                    values.len(),
                    if is_map { x.len() * y.len() } else { x.len() }
                );
                let own: Vec<Option<f64>> = values
                    .iter()
                    .map(|value| Some(*value).filter(|v| v.is_finite()))
                    .collect();
                let holds = |column: &(String, Vec<Option<f64>>)| column.1[..own.len()] == own;
                assert!(
                    columns
                        .iter()
                        .any(|column| column.1.len() >= own.len() && holds(column)),
                    "{name}"
                );
                seen += 1;
            }
        }
    }
    seen
}

#[test]
fn the_data_of_every_figure_of_a_page_are_in_files_that_agree() {
    let bench = fitted();
    bench.succeed("evaluate set --library a.lib --report folder");
    bench.succeed("report set --library a.lib --order 30 --out page.html --data data");
    bench.succeed(&format!("frontier --redraw {NUMBERS} --out frontier"));
    for (page, data) in [
        ("folder/index.html", "folder/data"),
        ("page.html", "data"),
        ("frontier/index.html", "frontier/data"),
    ] {
        let folder = bench.path(data);
        assert!(check_data(&folder) > 3, "{data}");
        let contents: Value = serde_json::from_str(&read(&folder.join("figures.json"))).unwrap();
        let figures = contents.as_array().unwrap();
        let page = read(&bench.path(page));
        assert_eq!(figures.len(), page.matches("<svg ").count(), "{data}");
        let with_numpy = std::process::Command::new("python3")
            .args(["-c", "import numpy, sys; a = numpy.load(sys.argv[1]); print(sum(a[k].size for k in a.files))"])
            .arg(folder.join("figures.npz"))
            .output();
        // NumPy itself, where it is there.
        if let Some(output) = with_numpy.ok().filter(|output| output.status.success()) {
            let all: usize = arrays(&folder.join("figures.npz"))
                .values()
                .map(|a| a.1.len())
                .sum();
            assert_eq!(
                String::from_utf8(output.stdout).unwrap().trim(),
                all.to_string()
            );
        }
    }
    bench.succeed("page a.lib --recordings set --out rub.html --data rub");
    assert_eq!(check_data(&bench.path("rub")), 2 * (1 + 9 + 9));
    // A folder with something else is left alone.
    bench.write("other/mine.txt", "mine");
    bench.refuse("report set --library a.lib --order 30 --out again.html --data other");
    assert!(!bench.path("again.html").exists());
}

/// Points at values of every panel of every picture, by formulas of its own, and returns what the box says: a list of
/// the picture's place on the page, the panel's in it, the series' in that, its kind, the values pointed at, the texts
/// in the box, and whether it lies within the window.
const HOVER: &str = "(async () => {
    const list = (text) => (text || '').split(' ').map((word) => word === '-' ? NaN : Number(word));
    const share = (axis, v) => axis.scale === 'log'
        ? Math.log(v / axis.from) / Math.log(axis.to / axis.from) : (v - axis.from) / (axis.to - axis.from);
    const found = [];
    for (const [figure, svg] of [...document.querySelectorAll('svg.plot')].entries()) {
        svg.scrollIntoView({ block: 'center' });
        for (const [panel, group] of [...svg.querySelectorAll('g.axes')].entries()) {
            const [left, top, right, bottom] = list(group.dataset.frame);
            const [xAxis, yAxis] = [JSON.parse(group.dataset.x), JSON.parse(group.dataset.y)];
            const point = async (x, y) => {
                const place = new DOMPoint(left + (right - left) * share(xAxis, x),
                    bottom - (bottom - top) * share(yAxis, y)).matrixTransform(svg.getScreenCTM());
                const event = new PointerEvent('pointermove',
                    { clientX: place.x, clientY: place.y, bubbles: true, pointerType: 'mouse' });
                group.dispatchEvent(event);
                if (group.querySelector('image') && !group.querySelector('image').pixels) {
                    await new Promise((done) => setTimeout(done, 100));
                    group.dispatchEvent(event);
                }
                const box = document.querySelector('.reading');
                const r = box.getBoundingClientRect();
                const root = document.documentElement;
                const within = r.left >= 0 && r.top >= 0 && r.right <= root.clientWidth && r.bottom <= root.clientHeight
                    && box.scrollHeight <= box.clientHeight + 1 && !box.hidden;
                return [[...box.children].map((line) => line.textContent), within];
            };
            for (const [index, series] of [...group.querySelectorAll('.series')].entries()) {
                const { kind } = series.dataset;
                if (kind === 'levels') {
                    const levels = JSON.parse(series.dataset.levels);
                    const x = levels.x[0] + 7 * levels.x[1], y = levels.y[0] + 20 * levels.y[1];
                    found.push([figure, panel, index, kind, 7, 20, null, ...await point(x, y)]);
                    continue;
                }
                const [x, y, z] = [list(series.dataset.x), list(series.dataset.y), list(series.dataset.z)];
                const at = Math.floor(x.length / 3);
                if (!Number.isFinite(y[at])) continue;
                found.push([figure, panel, index, kind, x[at], y[at], series.dataset.z ? z[at] : null,
                    ...await point(x[at], y[at])]);
            }
        }
    }
    return found;
})()";

/// Numbers in a text.
fn numbers_in(text: &str) -> Vec<f64> {
    let words = text.split([' ', ':', ',']);
    words.filter_map(|word| word.parse().ok()).collect()
}

/// Checks that the box tells the values of the data files wherever one points.
fn check_hover(browser: &mut Browser, data: &Path, name: &str) {
    let contents: Value = serde_json::from_str(&read(&data.join("figures.json"))).unwrap();
    let arrays = arrays(&data.join("figures.npz"));
    let told = browser.value(HOVER);
    let told = told.as_array().unwrap();
    assert!(told.len() > 5, "{name}: {told:?}");
    for one in told {
        let place = |index: usize| one[index].as_u64().unwrap() as usize;
        let figure = &contents[place(0)];
        let series = &figure["panels"][place(1)]["series"][place(2)];
        let what = format!("{name}: {}: {one}", figure["name"]);
        assert_eq!(one[8], true, "cut off: {what}");
        let texts: Vec<&str> = one[7]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_str)
            .collect();
        let array = |name: &Value| &arrays[name.as_str().unwrap()].1;
        let kind = one[3].as_str().unwrap();
        // The value in the file that stands where the page pointed.
        let value = match kind {
            "cells" | "levels" => {
                let index = |at: usize| one[at].as_f64().unwrap() as usize;
                let rows = array(&series["y"]).len();
                array(&series["z"]["array"])[index(4) * rows + index(5)]
            }
            _ => {
                let (x, y) = (one[4].as_f64().unwrap(), one[5].as_f64().unwrap());
                let near = |a: f64, b: f64| (a - b).abs() <= 1e-4 * a.abs().max(b.abs());
                let (xs, ys) = (array(&series["x"]), array(&series["y"]));
                let is_there = |(own_x, own_y): (&f64, &f64)| {
                    (near(*own_x, x) || kind == "bars") && near(*own_y, y)
                };
                assert!(xs.iter().zip(ys).any(is_there), "{what}");
                y
            }
        };
        if !value.is_finite() {
            continue;
        }
        // Four digits, or a step of the palette's 255 over 60 dB.
        let room = if kind == "levels" {
            0.13
        } else {
            1e-3 * value.abs() + 1e-9
        };
        let is_told = |text: &&str| {
            let beyond =
                kind == "levels" && (text.contains("at most") || text.contains("at least"));
            beyond
                || numbers_in(text)
                    .iter()
                    .any(|number| (number - value).abs() <= room)
        };
        assert!(texts.iter().any(is_told), "{what}: {value}");
    }
}

/// Clicks the middle of a map's cell with the mouse, or presses Enter on it, and waits until its sounds run.
fn check_node(browser: &mut Browser, by_key: bool, name: &str) {
    browser.value("delete globalThis.stylusPlayed; 1");
    let place = browser.value(
        "(() => {
            const group = document.querySelector('g.axes[data-play]:has([data-kind=cells])');
            group.scrollIntoView({ block: 'center' });
            const [left, top, right, bottom] = group.dataset.frame.split(' ').map(Number);
            const [x, y] = [JSON.parse(group.dataset.x), JSON.parse(group.dataset.y)];
            const p = new DOMPoint(left + (right - left) * 1.5 / x.names.length,
                bottom - (bottom - top) * 0.5 / y.names.length)
                .matrixTransform(group.closest('svg').getScreenCTM());
            return [p.x, p.y, group.dataset.play, Number(x.names[1]), Number(y.names[0])];
        })()",
    );
    for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
        if by_key && kind != "mouseMoved" {
            continue;
        }
        let button = if kind == "mouseMoved" { "none" } else { "left" };
        browser.call(
            "Input.dispatchMouseEvent",
            &serde_json::json!({"type": kind, "x": place[0], "y": place[1], "button": button, "clickCount": 1}),
        );
    }
    if by_key {
        browser
            .value("document.querySelector('g.axes[data-play]:has([data-kind=cells])').focus(); 1");
        for kind in ["keyDown", "keyUp"] {
            browser.call(
                "Input.dispatchKeyEvent",
                &serde_json::json!({"type": kind, "key": "Enter", "code": "Enter", "text": "\r",
                    "windowsVirtualKeyCode": 13}),
            );
        }
    }
    browser
        .wait("globalThis.stylusPlayed !== undefined && stylusPlayed.context.currentTime > 0.02");
    let played = browser.value("[stylusPlayed.texture, stylusPlayed.speed, stylusPlayed.force]");
    assert_eq!(
        played,
        serde_json::json!([place[2], place[3], place[4]]),
        "{name}, by key: {by_key}"
    );
    // It is heard: samples that are not silence, for the duration of both clips.
    let sound = "(() => { const b = stylusPlayed.source.buffer; const d = b.getChannelData(0); \
         return [b.duration, Math.max(...d.subarray(0, 20000).map(Math.abs))]; })()";
    let sound = browser.value(sound);
    assert!(
        sound[0].as_f64().unwrap() > 0.5 && sound[1].as_f64().unwrap() > 0.001,
        "{sound}"
    );
}

#[test]
#[ignore = "needs Chromium; tests/run runs it"]
fn pointing_tells_the_values_of_the_data_files_and_nodes_and_spectrograms_play() {
    let bench = fitted();
    bench.succeed("evaluate set --library a.lib --report folder");
    bench.succeed("report set --library a.lib --order 30 --out page.html --data data");
    bench.succeed(&format!("frontier --redraw {NUMBERS} --out frontier"));
    let mut browser = Browser::start(&bench.path(""));
    for (page, data) in [
        ("folder/index.html", "folder/data"),
        ("page.html", "data"),
        ("frontier/index.html", "frontier/data"),
    ] {
        browser.open(&bench.path(page));
        for width in [1400, 420] {
            browser.call(
                "Emulation.setDeviceMetricsOverride",
                &serde_json::json!({"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false}),
            );
            check_hover(
                &mut browser,
                &bench.path(data),
                &format!("{page} at {width}"),
            );
        }
        if page.starts_with("frontier") {
            continue;
        }
        for by_key in [false, true] {
            check_node(&mut browser, by_key, page);
        }
    }
    // A click in a spectrogram plays its sound from there.
    browser.open(&bench.path("page.html"));
    let place = browser.value(
        "(() => { const group = document.querySelector('g.axes[data-name=recorded] > image').parentNode; \
         const svg = group.closest('svg'); svg.scrollIntoView({ block: 'center' }); \
         const [left, top, right, bottom] = group.dataset.frame.split(' ').map(Number); \
         const { to } = JSON.parse(group.dataset.x); \
         const p = new DOMPoint(left + (right - left) * 0.5 / to, (top + bottom) / 2) \
             .matrixTransform(svg.getScreenCTM()); return [p.x, p.y]; })()",
    );
    // By the mouse, because a browser plays nothing that no one asked for.
    for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
        let button = if kind == "mouseMoved" { "none" } else { "left" };
        browser.call(
            "Input.dispatchMouseEvent",
            &serde_json::json!({"type": kind, "x": place[0], "y": place[1], "button": button, "clickCount": 1}),
        );
    }
    browser.wait(
        "[...document.querySelectorAll('audio[data-panel=recorded]')].some((a) => a.played.length > 0 && \
         a.played.start(0) > 0.4 && a.currentTime > 0.5)",
    );
    let (requests, errors) = browser.requests_and_errors();
    let is_own = |url: &String| {
        ["file:", "data:", "about:"]
            .iter()
            .any(|own| url.starts_with(own))
    };
    assert!(requests.iter().all(is_own), "{requests:?}");
    assert!(errors.is_empty(), "{errors:?}");
}

/// Elements whose text is cut off or that make the page wider than its window, in the page as it is shown.
const TOO_WIDE: &str = "(() => {
    const root = document.documentElement;
    const found = [];
    if (root.scrollWidth > root.clientWidth) found.push('page: ' + root.scrollWidth);
    for (const e of document.querySelectorAll('body *')) {
        if (e.closest('svg') || e.closest('.wide') && !e.matches('.wide')) continue;
        const r = e.getBoundingClientRect();
        if (r.width > 0 && (r.right > root.clientWidth + 1 || r.left < -1)) found.push(e.tagName + '.' + e.className);
    }
    return found;
})()";

/// Tables and pictures that scroll.
const SCROLLING: &str = "[...document.querySelectorAll('.wide')]
    .filter((e) => e.scrollWidth > e.clientWidth + 1)
    .map((e) => e.getAttribute('aria-label')
        ?? document.getElementById(e.getAttribute('aria-labelledby')).textContent)";

/// Pairs of texts in one picture whose boxes, as the browser lays them out, have more than a pixel in common.
const COVERED: &str = "(() => {
    const found = [];
    for (const svg of document.querySelectorAll('svg')) {
        const texts = [...svg.querySelectorAll('text')].map((e) => [e.textContent.trim(), e.getBoundingClientRect()]);
        texts.forEach(([a, r], i) => {
            for (const [b, s] of texts.slice(i + 1)) {
                const x = Math.min(r.right, s.right) - Math.max(r.left, s.left);
                const y = Math.min(r.bottom, s.bottom) - Math.max(r.top, s.top);
                // A line's box is higher than its letters.
                if (x > 1 && y > 4) found.push(svg.getAttribute('aria-label') + ': ' + a + ' / ' + b);
            }
        });
    }
    return found;
})()";

fn check_in(browser: &mut Browser, page: &Path, name: &str) {
    browser.open(page);
    for width in [420, 900, 1400] {
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            &serde_json::json!({"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false}),
        );
        let wide = browser.value(TOO_WIDE);
        assert_eq!(wide, serde_json::json!([]), "{name} at {width}");
        if width == 1400 {
            assert_eq!(
                browser.value(SCROLLING),
                serde_json::json!([]),
                "{name} at {width}"
            );
            assert_eq!(browser.value(COVERED), serde_json::json!([]), "{name}");
        }
        for scheme in ["light", "dark"] {
            browser.prefer(scheme);
            let least = browser.least_contrast();
            assert!(least >= 4.5, "{name}, {width}, {scheme}: {least}");
            if let Ok(folder) = std::env::var("STYLUS_SCREENSHOTS") {
                let path = format!("{folder}/{name}-{width}-{scheme}.png.base64");
                std::fs::write(path, browser.screenshot()).unwrap();
            }
        }
    }
    // Letters of a picture are readable on a narrow window: its text is ten pixels high.
    let least = "Math.min(...[...document.querySelectorAll('svg')].map((e) => \
         e.getBoundingClientRect().width / e.viewBox.baseVal.width * 26))";
    assert!(browser.value(least).as_f64().unwrap() >= 9.5, "{name}");
    let broken = "[...document.querySelectorAll('a')].filter((a) => \
         document.getElementById(a.hash.slice(1)) === null).length";
    assert_eq!(browser.value(broken), 0, "{name}");
    let nameless = "[...document.querySelectorAll('audio, svg, figure, .wide')].filter((e) => \
         !(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby'))).length";
    assert_eq!(browser.value(nameless), 0, "{name}");
    let sound = "(async () => { for (const a of document.querySelectorAll('audio')) { \
         const loaded = new Promise((done, failed) => { a.onloadedmetadata = done; a.onerror = failed; }); \
         a.load(); a.preload = 'auto'; await loaded; if (!(a.duration > 0.5)) return a.duration; } return 'all'; })()";
    assert_eq!(browser.value(sound), "all", "{name}");
    let (requests, errors) = browser.requests_and_errors();
    let is_own = |url: &String| {
        ["file:", "data:", "about:"]
            .iter()
            .any(|own| url.starts_with(own))
    };
    assert!(requests.iter().all(is_own), "{name}: {requests:?}");
    assert!(errors.is_empty(), "{name}: {errors:?}");
}

#[test]
#[ignore = "needs Chromium; tests/run runs it"]
fn pages_are_readable_on_narrow_and_wide_windows_in_light_and_dark_and_ask_for_nothing() {
    let bench = fitted();
    bench.succeed("simulate-rig --rig rig.toml --seed 2 --out takes");
    bench.succeed("evaluate set --library a.lib --report folder");
    bench.succeed("report set --library a.lib --takes takes --order 30 --out page.html");
    bench.succeed(&format!(
        "frontier --redraw {NUMBERS} --before {NUMBERS} --out frontier"
    ));
    let mut browser = Browser::start(&bench.path(""));
    for (page, name) in [
        ("folder/index.html", "evaluation"),
        ("page.html", "report"),
        ("frontier/index.html", "frontier"),
    ] {
        check_in(&mut browser, &bench.path(page), name);
    }
}

#[test]
#[ignore = "half a minute of the processor; tests/run runs it"]
fn the_sounds_of_a_page_take_24_megabytes_at_most_and_those_left_out_are_said() {
    /// Two sounds of 3 s per texture, 16 bits at 20 kHz, are beyond the bound with so many.
    const TEXTURES: u64 = 106;
    const MOST_BYTES: usize = 24_000_000;
    let bench = Bench::new();
    let mut list = String::from("file,texture,speed_mm_s,force_n\n");
    for number in 0..TEXTURES {
        let signal = noise(number, 6 * RATE_HZ as usize);
        bench.write(&format!("set/{number}.wav"), wav(&[&signal], RATE_HZ));
        list.push_str(&format!("{number}.wav,texture {number},100,1\n"));
    }
    bench.write("set/trials.csv", list);
    bench.succeed("report set --order 2 --out page.html");
    let page = std::fs::read_to_string(bench.path("page.html")).unwrap();
    let sounds = page.split("data:audio/wav;base64,").skip(1);
    let bytes: usize = sounds
        .map(|sound| sound.find(['"', '\'', '`']).expect("it ends") / 4 * 3)
        .sum();
    assert!(bytes <= MOST_BYTES + 1000, "{bytes} bytes of sounds");
    assert!(bytes > MOST_BYTES / 2, "{bytes} bytes of sounds");
    assert!(page.contains("No sounds"), "what is left out is said");
}
