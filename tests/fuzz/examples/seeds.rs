//! Writes small valid libraries for the fuzzer to begin with into the folder that is its only argument: each structure, grids
//! of one and of several nodes, orders 0 to 400.

use std::error::Error;
use std::path::PathBuf;

use model_format::{
    CodeSpec, NodeFlags, NodeSpec, Provenance, Structure, TextureSpec, encode_uncertified, limits,
};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1);
    let folder = PathBuf::from(folder.ok_or("say which folder to write the seeds to")?);
    let structures = [
        Structure::NormalisedLattice,
        Structure::DirectForm16,
        Structure::DirectForm32,
    ];
    let mut all = Vec::new();
    for structure in structures {
        for (order, size) in [(0, 1), (3, 1), (3, 2), (17, 3), (limits::MAX_ORDER, 1)] {
            let name = format!("{structure} {order} × {size}²");
            all.push(texture(name, structure, order, size));
        }
    }
    for (index, texture) in all.iter().enumerate() {
        let bytes = encode_uncertified(std::slice::from_ref(texture))?;
        std::fs::write(folder.join(format!("single-{index}")), bytes)?;
    }
    all.retain(|texture| {
        texture.nodes[0].codes != CodeSpec::Lattice(vec![]) && texture.nodes.len() < 5
    });
    std::fs::write(folder.join("several"), encode_uncertified(&all[..4])?)?;
    Ok(())
}

/// A texture of `size` × `size` nodes.
fn texture(name: String, structure: Structure, order: usize, size: usize) -> TextureSpec {
    let values = |unit: f32| (0..size).map(|step| unit * step as f32).collect();
    let axis = |unit| if size == 1 { vec![unit] } else { values(unit) };
    let (speed_axis_mm_s, force_axis_n) = (axis(100.0), axis(0.5));
    let node = |index: usize| {
        let silent = size > 1 && (index < size || index.is_multiple_of(size));
        NodeSpec {
            output_power: if silent { 0.0 } else { 4.0 },
            prediction_error_power: if silent { 0.0 } else { 1.0 },
            flags: if silent {
                NodeFlags::SILENT
            } else {
                NodeFlags::DOUBTFUL
            },
            codes: codes(structure, order),
        }
    };
    let cell_margins = match structure {
        // Both with and without a certificate: what is changed under one is refused, and found no further.
        Structure::DirectForm16 | Structure::DirectForm32 if size == 2 => vec![4],
        _ => Vec::new(),
    };
    TextureSpec {
        name,
        sample_rate_hz: 5000,
        structure,
        provenance: Provenance::Simulated,
        speed_axis_mm_s,
        force_axis_n,
        nodes: (0..size * size).map(node).collect(),
        cell_margins: cell_margins,
    }
}

/// Alternating, and falling with the square of the index.
fn codes(structure: Structure, order: usize) -> CodeSpec {
    let falling = (1..=order as i32)
        .map(|index| (if index % 2 == 0 { 1 } else { -1 }) * 20_000 / (index * index));
    match structure {
        Structure::NormalisedLattice => {
            CodeSpec::Lattice(falling.map(|code| code as i16).collect())
        }
        Structure::DirectForm16 => CodeSpec::Direct16 {
            exponent: 1,
            codes: falling.map(|code| code as i16).collect(),
        },
        Structure::DirectForm32 => CodeSpec::Direct32 {
            exponent: 2,
            codes: falling.map(|code| code << 14).collect(),
        },
    }
}
