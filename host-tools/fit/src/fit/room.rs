//! The room of a library: a set that cannot fit into one is refused before its recordings are read, with what fits.

use model_format::{DecodeError, Problem, TextureSpec, limits};
use stylus_signals::recording::RecordingSet;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::grid::axis;
use super::options::{Options, Order};

/// Bytes of a node without its coefficients.
const NODE_BYTES: usize = 16;

/// Part of a library that [`largest_order`] gives to nodes. The rest is for names, lines and steps of tails.
const SHARE_OF_NODES: f64 = 0.95;

/// Checks that the models of `set` may fit into a library, by its list alone. Nodes are counted as if none were silent,
/// with the fewest bytes that their order allows.
///
/// # Errors
/// More textures or bytes than a library holds, or a longer axis than a grid has.
pub(super) fn check(set: &RecordingSet, options: &Options) -> Result<()> {
    // If verdicts drop trials, the grids are known only once the recordings were read.
    if !options.drop.is_empty() {
        return Ok(());
    }
    let nodes = |(name, members): (&str, Vec<usize>)| {
        let trials = members.iter().map(|&index| &set.trials[index]);
        let played = || trials.clone().filter(|trial| trial.is_in_motion_and_contact());
        let speeds = axis(name, "speeds", played().map(|trial| trial.speed_mm_s))?;
        let forces = axis(name, "forces", played().map(|trial| trial.force_n))?;
        Ok(speeds.len() * forces.len())
    };
    let nodes = set
        .by_texture()
        .into_iter()
        .map(nodes)
        .collect::<Result<Vec<usize>>>()?;
    let order = match options.order {
        Order::Auto | Order::Bayesian => 0,
        Order::Fixed(order) => order,
    };
    let least = NODE_BYTES + order + order.min(limits::MAX_FINE_STAGES);
    let bytes = nodes.iter().sum::<usize>() * least;
    if nodes.len() > limits::MAX_TEXTURES || bytes > limits::MAX_LIBRARY_BYTES {
        return Err(too_large(&nodes, &format!("at least {bytes}")));
    }
    Ok(())
}

/// Returns the error of `textures` that do not make a library because of `failure`.
pub(super) fn refused(failure: &DecodeError, textures: &[TextureSpec]) -> Error {
    match failure.problem {
        Problem::Range {
            what: "its length in bytes",
            value,
            ..
        } => {
            let nodes: Vec<usize> = textures.iter().map(|texture| texture.nodes.len()).collect();
            too_large(&nodes, &value.to_string())
        }
        _ => Error::Model(format!("the textures do not make a library: {failure}")),
    }
}

/// Returns the error of textures with these numbers of nodes, which take that many `bytes`, with what makes them fit.
fn too_large(nodes: &[usize], bytes: &str) -> Error {
    let is_one = nodes.len() == 1;
    let largest = |nodes: usize| largest_order(nodes).map(|order| format!("--order {order}"));
    let all = largest(nodes.iter().sum()).filter(|_| nodes.len() <= limits::MAX_TEXTURES);
    let each = (!is_one).then(|| match largest(nodes.iter().copied().max().unwrap_or(0)) {
        // Models of any order fit.
        Some(order) if order == format!("--order {}", limits::MAX_ORDER) => Some("--each".to_owned()),
        order => Some(format!("--each with {}", order?)),
    });
    let remedies: Vec<String> = all.into_iter().chain(each.flatten()).collect();
    let remedies = if remedies.is_empty() {
        "fewer speeds or forces, as with --snap auto".to_owned()
    } else {
        remedies.join(", or ")
    };
    Error::Model(format!(
        "{} of {} take {bytes} bytes, and a library holds {} textures and {} bytes: give {remedies}",
        counted(nodes.iter().sum::<usize>(), "node"),
        counted(nodes.len(), "texture"),
        limits::MAX_TEXTURES,
        limits::MAX_LIBRARY_BYTES
    ))
}

/// Returns the largest order of which this number of `nodes` fits into a library; `None` if there is none above 0.
fn largest_order(nodes: usize) -> Option<usize> {
    let room = (SHARE_OF_NODES * limits::MAX_LIBRARY_BYTES as f64) as usize / nodes.max(1);
    let room = room.checked_sub(NODE_BYTES)?;
    // A first stage takes two bytes and one of fine theta, a further one a byte.
    let first = (room / 3).min(limits::MAX_FINE_STAGES);
    let order = (room - 2 * first).min(limits::MAX_ORDER);
    let order = if first < limits::MAX_FINE_STAGES { first } else { order };
    (order > 0).then_some(order)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fit;
    use model_format::{CodeSpec, NodeSpec, encode};
    use stylus_signals::recording::Trial;

    fn set(textures: usize, speeds: usize, forces: usize) -> RecordingSet {
        let trial = |n: usize| {
            let (name, at) = (format!("t{}", n / (speeds * forces)), n % (speeds * forces));
            let (speed, force) = (1 + at / forces, 1 + at % forces);
            Trial::of("nothing.wav", name, speed as f64, force as f64)
        };
        RecordingSet {
            trials: (0..textures * speeds * forces).map(trial).collect(),
            is_listed: true,
        }
    }

    /// The recordings do not exist, so that another error would come from a set that is read.
    #[test]
    fn what_cannot_fit_is_refused_before_a_recording_is_read_and_the_remedies_are_not() {
        let refusal = |set: &RecordingSet, order: Order| {
            let options = Options {
                order,
                ..Options::default()
            };
            let error = fit(set, &options, |_| ()).unwrap_err().to_string();
            (!error.contains("nothing.wav")).then_some(error)
        };
        for (textures, speeds, forces, order) in [
            (16, 24, 20, Order::Fixed(100)),
            (1, 40, 40, Order::Fixed(400)),
            (300, 1, 1, Order::Auto),
            (10, 64, 64, Order::Auto),
            (100, 20, 20, Order::Auto),
        ] {
            let whole = set(textures, speeds, forces);
            for remedy in refusal(&whole, order)
                .expect("too large")
                .split("give ")
                .nth(1)
                .unwrap()
                .split(", or ")
            {
                let of_remedy = remedy
                    .split("--order ")
                    .nth(1)
                    .map(|order| Order::Fixed(order.parse().unwrap()));
                let part = if remedy.starts_with("--each") {
                    set(1, speeds, forces)
                } else {
                    whole.clone()
                };
                assert_eq!(refusal(&part, of_remedy.unwrap_or(order)), None, "{remedy}");
            }
        }
        for (textures, speeds, forces) in [(16, 24, 20), (256, 10, 10), (1, 64, 64)] {
            assert_eq!(refusal(&set(textures, speeds, forces), Order::Auto), None);
        }
    }

    #[test]
    fn models_of_the_order_that_a_refusal_names_make_a_library() {
        for nodes in [120, 400, 1600, 4000, 20_000] {
            let Some(order) = largest_order(nodes) else {
                continue;
            };
            let node = || {
                NodeSpec::new(
                    4.0,
                    CodeSpec::compact_lattice(&vec![(1 << 20) + 77; order], limits::MAX_FINE_STAGES),
                )
            };
            let grid = |nodes: usize, name: &str| {
                let speeds: Vec<f32> = (1..=nodes / 40).map(|speed| speed as f32).collect();
                let forces: Vec<f32> = (1..=40).map(|force| force as f32).collect();
                TextureSpec::new(name, &speeds, &forces, (0..speeds.len() * 40).map(|_| node()).collect())
            };
            let textures = nodes.div_ceil(2000);
            let textures: Vec<_> = (0..textures).map(|n| grid(nodes / textures, &format!("{n}"))).collect();
            let length = encode(&textures).expect("it fits").len();
            assert!(
                order == limits::MAX_ORDER || length > limits::MAX_LIBRARY_BYTES * 4 / 5,
                "{order}: {length}"
            );
        }
    }
}
