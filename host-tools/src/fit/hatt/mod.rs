//! Models of the Penn Haptic Texture Toolkit (HaTT; Culbertson, Lopez Delgado, Kuchenbecker, IEEE Haptics Symposium
//! 2014) as textures: its XML files are the user's own, nothing of them is here.
//!
//! A file has ARMA models at scattered speeds and forces, y(n) = -Σ a(i) y(n-i) + g (e(n) + Σ b(j) e(n-j)) with e white
//! of variance var, at 1 kHz, and triangles over them; within a triangle line spectral frequencies and variances are
//! interpolated. The stylus plays AR models at 5 kHz over a rectangle of speeds and forces. So the models are
//! interpolated as their makers do, at every node of a rectangle, and refitted from their own spectrum ([`convert`]).
//!
//! | in the file | what becomes of it |
//! |---|---|
//! | not XML, a number that is none, no models, triangles out of range | refused, with the place |
//! | a model that is unstable, or whose variance or gain is negative or not finite | left out with triangles; said |
//! | a model of variance zero | silence; the timbre around it is that of its neighbours |
//! | line spectral frequencies that are not those of the coefficients | said; the coefficients count |

pub mod convert;
pub mod read;
