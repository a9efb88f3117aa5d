//! Times of the vision kernels on one core: `cargo bench -p slam-vision`.
fn main() {
    divan::main();
}
