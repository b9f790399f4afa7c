//! Arguments of the linker for a module whose symbols of the interpreter come from the one that loads it. macOS refuses
//! such a module without them.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
