//! Import of models of the Penn Haptic Texture Toolkit (HaTT; Culbertson, Lopez Delgado, Kuchenbecker, IEEE Haptics
//! Symposium 2014) as textures. Its XML files are supplied by the user; this repository holds nothing of them.
//!
//! A file has ARMA models at scattered speeds and forces, y(n) = -Σ a(i) y(n-i) + g Σ b(j) e(n-j), at 1 or 10 kHz,
//! where e is white with variance var; and triangles over them. Within a triangle, line spectral frequencies, variances
//! and gains are interpolated. The stylus plays AR models at 5 or 10 kHz over a rectangle of speeds and forces. So the
//! models are interpolated at every node of a rectangle in the way of their authors, and an AR model is fitted to each
//! interpolated spectrum ([`convert`]). What the library plays is compared with the file's definition.
//!
//! | in the file | what becomes of it |
//! |---|---|
//! | not XML, text in place of a number, other units | refused, with the line |
//! | another number of models or triangles than stated, triangles of missing models | refused, with the line |
//! | no models, more triangles than fit beside each other, another sample rate than models have | refused |
//! | models with power but different orders | refused |
//! | an unstable model, or one with a negative or not finite variance or gain | left out with triangles; reported |
//! | a model of variance zero | silence; its shape counts, as in HaTT, if it has the others' order |
//! | line spectral frequencies that are not those of the coefficients | they count, as in HaTT's renderer |
//! | a first coefficient of MA that is not 1 | b(0), a factor of the gain |
//! | models that no triangle uses, triangles that leave gaps, unknown elements | nothing |

pub mod axes;
mod between;
pub mod convert;
mod elements;
#[cfg(test)]
mod fixture;
pub mod import;
pub mod read;
pub mod toolkit;
