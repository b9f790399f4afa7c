//! Seeds of the fuzzer, in one folder per target. The decoder's seeds are small valid libraries: grids of one and of
//! several nodes, orders 0 to 400, and every optional part. For each parser of the host there is a small file of each
//! kind.

use std::error::Error;
use std::path::Path;

use model_format::scene::{Biquad, Region, Scene, SceneName, StickSlip, Surface, Tap};
use model_format::{
    BLOCK_SAMPLES, CodeSpec, CodebookSpec, ExcitationSpec, FadeLaw, Laws, LevelLaw, LineSpec, LinesSpec, NodeFlags,
    NodeSpec, TextureSpec, Wander, encode, encode_with_scenes, limits,
};

/// Writes the seeds of every target into the target's folder below `root`.
pub fn write(root: &Path) -> Result<(), Box<dyn Error>> {
    #[cfg(feature = "parsers")]
    crate::parsers::seeds::write(root)?;
    let folder = root.join("decode");
    std::fs::create_dir_all(&folder)?;
    libraries(&folder)
}

/// Writes the decoder's seeds into `folder`.
fn libraries(folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut all = textures();
    for (index, texture) in all.iter().enumerate() {
        let bytes = encode(std::slice::from_ref(texture))?;
        std::fs::write(folder.join(format!("single-{index}")), bytes)?;
    }
    all.retain(|texture| texture.nodes[0].codes != CodeSpec::lattice(vec![]) && texture.nodes.len() < 5);
    std::fs::write(folder.join("several"), encode(&all[..4])?)?;
    let with_scenes = encode_with_scenes(&all[..2], &[scene()?])?;
    std::fs::write(folder.join("scenes"), with_scenes)?;
    all.retain(|texture| texture.parts.excitation.is_some());
    let with_scenes = encode_with_scenes(&all[..2], &[scene()?])?;
    std::fs::write(folder.join("fed-scenes"), with_scenes)?;
    Ok(())
}

/// A texture for each kind of grid and of part.
fn textures() -> Vec<TextureSpec> {
    let mut all = Vec::new();
    for (order, size) in [(0, 1), (3, 1), (3, 2), (17, 3), (limits::MAX_ORDER, 1)] {
        let name = format!("{order} × {size}²");
        all.push(texture(name, order, size));
    }
    for level in LevelLaw::ALL {
        let mut with_parts = texture(format!("{level}"), 40, 1);
        with_parts.laws = Laws {
            level,
            fade: FadeLaw::Power,
        };
        let thetas: Vec<i32> = (0..40).map(|stage| 100_003 * (stage % 9 - 4)).collect();
        with_parts.nodes[0].codes = CodeSpec::fine_lattice(&thetas);
        all.push(with_parts);
    }
    for (order, size) in [(33, 1), (40, 3), (limits::MAX_ORDER, 1)] {
        let mut with_tails = texture(format!("tails {order} × {size}²"), order, size);
        for node in &mut with_tails.nodes {
            let thetas: Vec<i32> = node.codes.thetas().map(|theta| theta + 99).collect();
            node.codes = CodeSpec::compact_lattice(&thetas, order % 32);
        }
        all.push(with_tails);
    }
    for lines in [1, limits::MAX_LINES] {
        let mut lined = texture(format!("{lines} lines"), 3, 2);
        lined.parts.lines = Some(lines_of(lines));
        all.push(lined);
    }
    all.push(wandering_lines());
    for codebooks in [1, 3] {
        let mut fed = texture(format!("{codebooks} codebooks"), 5, 2);
        fed.parts.excitation = Some(excitation(codebooks, fed.nodes.len()));
        all.push(fed);
    }
    all
}

/// A texture with three lines, two of which have wander.
fn wandering_lines() -> TextureSpec {
    let mut wandering = texture("wandering lines".into(), 3, 2);
    let mut lines = lines_of(3).lines;
    (lines[0].wander, lines[2].wander) = (Some(1), Some(0));
    let wander = |clock_mm_s| Wander {
        rms_mm: 0.1,
        correlation_mm: 2.0,
        clock_mm_s,
    };
    let wanders = [0.0, 90.0].map(wander);
    wandering.parts.lines = Some(LinesSpec::with_wanders(lines, &wanders));
    wandering
}

/// `lines` lines for a texture of 2 × 2 nodes. Only the last node is both in motion and in contact.
fn lines_of(lines: usize) -> LinesSpec {
    let line = |at: usize| LineSpec {
        wavelength_mm: 0.5 * (at + 1) as f32,
        phase: 30_000,
        amplitudes: vec![0.0, 0.0, 0.0, 1.0],
        ..LineSpec::default()
    };
    let lines: Vec<LineSpec> = (0..lines).map(line).collect();
    LinesSpec::from(lines)
}

/// `codebooks` codebooks, all of the shortest length.
fn excitation(codebooks: usize, nodes: usize) -> ExcitationSpec {
    // Samples of the highest magnitude and either sign in turn, in blocks of level 0.
    let block = [[0xfb, 0xbe, 0xef].repeat(8), vec![0]].concat();
    let codebook = CodebookSpec {
        peak: 1.0,
        blocks: block.repeat(limits::MIN_CODEBOOK_SAMPLES.div_ceil(BLOCK_SAMPLES)),
    };
    ExcitationSpec {
        codebooks: vec![codebook; codebooks],
        of_nodes: (0..nodes).map(|node| (node % (codebooks + 1)) as u8).collect(),
    }
}

/// Two surfaces side by side, with every effect.
fn scene() -> Result<Scene, Box<dyn Error>> {
    let mut surface = Surface::of_texture(0);
    surface.tap = Some(Tap {
        frequency_hz: 200.0,
        decay_s: 0.01,
        gain_m_s2_per_n_s: 0.1,
        limit_m_s2: 20.0,
    });
    surface.stick_slip = Some(StickSlip {
        period_mm: 1.0,
        duty: 0.5,
        depth: 0.9,
        below_mm_s: 80.0,
        above_n: 0.5,
    });
    let name = SceneName::try_from("all").map_err(|_| "a name is too long")?;
    let mut scene = Scene::of_surface(name, 5000, surface);
    scene
        .surfaces
        .push(Surface::of_texture(1))
        .map_err(|_| "too many surfaces")?;
    for surface in 0..2u8 {
        let region = Region {
            start_mm: 10.0 * f32::from(surface),
            end_mm: 10.0 * f32::from(surface + 1),
            surface,
        };
        scene.regions.push(region).map_err(|_| "too many regions")?;
    }
    scene.transition_mm = 2.0;
    let section = Biquad {
        numerator: [1 << 28, -(1 << 27), 0],
        denominator: [-(1 << 28), 1 << 27],
    };
    scene.equaliser.push(section).map_err(|_| "too many sections")?;
    Ok(scene)
}

/// A texture of `size` × `size` nodes.
fn texture(name: String, order: usize, size: usize) -> TextureSpec {
    let values = |unit: f32| (0..size).map(|step| unit * step as f32).collect();
    let axis = |unit| if size == 1 { vec![unit] } else { values(unit) };
    let node = |index: usize| {
        let silent = size > 1 && (index < size || index.is_multiple_of(size));
        NodeSpec {
            output_power: if silent { 0.0 } else { 4.0 },
            prediction_error_power: if silent { 0.0 } else { 1.0 },
            flags: if silent { NodeFlags::SILENT } else { NodeFlags::DOUBTFUL },
            codes: codes(order),
        }
    };
    let nodes = (0..size * size).map(node).collect();
    TextureSpec::new(&name, &axis(100.0), &axis(0.5), nodes)
}

/// Codes of alternating sign, whose magnitude falls with the square of the index.
fn codes(order: usize) -> CodeSpec {
    let falling = (1..=order as i32).map(|index| (if index % 2 == 0 { 1 } else { -1 }) * 20_000 / (index * index));
    CodeSpec::lattice(falling.map(|code| code as i16).collect())
}
