//! Scenes in an existing library, and several libraries as one.

use std::collections::HashMap;
use std::path::Path;

use model_format::limits::MAX_TEXTURES;
use model_format::scene::Scene;
use model_format::{Library, NodeSpec, PartsSpec, Texture, TextureSpec, encode_with_scenes};
use stylus_support::names::{listed, nearly};
use stylus_support::{Error, Result};

use super::compile::CompiledScene;

/// Encodes `library` with `scenes` added. They replace scenes of the same name; all others stay the same.
pub fn with_scenes(library: &Library<'_>, scenes: &[Scene]) -> Result<Vec<u8>> {
    let textures: Vec<TextureSpec> = library.textures().map(|texture| texture_spec(&texture)).collect();
    let is_replaced = |old: &Scene| scenes.iter().any(|new| new.name == old.name);
    let mut all: Vec<Scene> = library.scenes().filter(|old| !is_replaced(old)).collect();
    all.extend_from_slice(scenes);
    encode_with_scenes(&textures, &all)
        .map_err(|error| Error::Model(format!("the library cannot hold these scenes: {error}")))
}

/// Encodes the textures and scenes of `libraries`, each with its file, as one library, in this order.
///
/// # Errors
/// Two textures or two scenes of one name; more than a library can hold.
pub fn joined(libraries: &[(&Path, Library<'_>)]) -> Result<Vec<u8>> {
    let count = libraries.iter().map(|(_, library)| library.len()).sum::<usize>();
    if count > MAX_TEXTURES {
        return Err(Error::Request(format!(
            "the libraries have {count} textures, and one library holds {MAX_TEXTURES}: join fewer"
        )));
    }
    let (mut textures, mut scenes, mut owners) = (Vec::new(), Vec::new(), HashMap::new());
    for (path, library) in libraries {
        let mut claim =
            |kind: &'static str, name: &str, remedy: &str| match owners.insert((kind, name.to_owned()), *path) {
                None => Ok(()),
                Some(other) => Err(Error::file(
                    path,
                    format!("has a {kind} '{name}', like {}: {remedy}", other.display()),
                )),
            };
        // Fewer than `MAX_TEXTURES`, which a scene's index of a texture counts.
        let before = textures.len() as u8;
        for texture in library.textures() {
            claim("texture", texture.name(), "fit one of them with another name")?;
            textures.push(texture_spec(&texture));
        }
        for mut scene in library.scenes() {
            claim("scene", &scene.name, "compile one of them with another name")?;
            scene
                .surfaces
                .iter_mut()
                .filter_map(|surface| surface.texture.as_mut())
                .for_each(|texture| *texture += before);
            scenes.push(scene);
        }
    }
    encode_with_scenes(&textures, &scenes)
        .map_err(|error| Error::Model(format!("one library cannot hold all of these: {error}")))
}

/// Returns the specification of a decoded texture, which encodes to the same bytes.
pub fn texture_spec(texture: &Texture<'_>) -> TextureSpec {
    TextureSpec {
        name: texture.name().to_owned(),
        sample_rate_hz: texture.sample_rate_hz(),
        provenance: texture.provenance(),
        laws: texture.laws(),
        parts: parts(texture),
        speed_axis_mm_s: texture.speed_axis().values().collect(),
        force_axis_n: texture.force_axis().values().collect(),
        nodes: texture
            .nodes()
            .map(|node| NodeSpec {
                output_power: node.output_power,
                prediction_error_power: node.prediction_error_power,
                flags: node.flags,
                codes: node.coefficients.into(),
            })
            .collect(),
    }
}

/// Returns the parts of a decoded texture, which encode to the same bytes.
pub fn parts(texture: &Texture<'_>) -> PartsSpec {
    PartsSpec {
        excitation: texture.excitation().map(Into::into),
        lines: texture.lines().map(Into::into),
    }
}

/// Returns the names of the surfaces of a scene from a library. They are the textures' names, because a library stores
/// no others.
pub fn surface_names(scene: &Scene, library: &Library<'_>) -> Vec<String> {
    scene
        .surfaces
        .iter()
        .enumerate()
        .map(|(index, surface)| {
            let texture = surface
                .texture
                .and_then(|texture| library.textures().nth(usize::from(texture)));
            match texture {
                Some(texture) => texture.name().to_owned(),
                None => format!("surface {}", index + 1),
            }
        })
        .collect()
}

/// Returns the scene `name` of `library`, or its only scene if no name is given; `path` is only named in errors.
///
/// # Errors
/// A library without this scene (the error lists its scenes); a library with several scenes if no name is given.
pub fn scene_named(library: &Library<'_>, name: Option<&str>, path: &Path) -> Result<CompiledScene> {
    let names: Vec<String> = library.scenes().map(|scene| scene.name.as_str().to_owned()).collect();
    let found = match name {
        Some(name) => library.scene(name),
        None if names.len() == 1 => library.scenes().next(),
        None => None,
    };
    let Some(scene) = found else {
        let textures: Vec<&str> = library.textures().map(|texture| texture.name()).collect();
        let problem = match (name, names.is_empty()) {
            (_, true) => "has no scenes; add some with 'stylus scene compile'".to_owned(),
            (Some(name), _) => {
                let texture = nearly(name, &textures);
                let texture = texture.map(|texture| format!("; '{texture}' is a texture of it"));
                format!(
                    "has no scene '{name}'; it has {}{}",
                    listed(name, &names),
                    texture.unwrap_or_default()
                )
            }
            (None, _) => format!("has several scenes; name one with --scene: {}", names.join(", ")),
        };
        return Err(Error::file(path, problem));
    };
    Ok(CompiledScene {
        surface_names: surface_names(&scene, library),
        scene,
    })
}
