//! Nodes of a library's first texture, a line each, speed-major: output power, (m/s²)², then θ of each stage, rad.
//!
//! `nodes LIBRARY`

use model_format::{FINE_THETA_STEP_RAD, Library};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let bytes = std::fs::read(std::env::args().nth(1).ok_or("nodes LIBRARY")?)?;
    let texture = Library::decode(&bytes)?.texture_at(0).ok_or("no texture")?;
    for node in texture.nodes() {
        print!("{}", node.output_power);
        for theta in node.coefficients.thetas() {
            print!(" {}", f64::from(theta) * FINE_THETA_STEP_RAD);
        }
        println!();
    }
    Ok(())
}
