//! The tests are in `tests/`; the image that they run is in `guest/`.
