//! Properties of the whole choice, from a set of recordings to the parts of its textures.
