//! The stylus's image: `stylus-firmware` has its `main`.
#![no_std]
#![no_main]

use stylus_firmware as _;
