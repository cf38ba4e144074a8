//! Times the making of samples on one thread: `data_speed SEARCH_SIZE COUNT WHAT[:SHARE]...`.

use std::time::Instant;
use trainer::data::{DataOptions, Dataset};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [size, count, specs @ ..] = &args[..] else {
        return Err("usage: data_speed SEARCH_SIZE COUNT WHAT[:SHARE]...".into());
    };
    let (size, count): (usize, u64) = (size.parse()?, count.parse()?);
    let specs: Result<Vec<_>, _> = specs.iter().map(|spec| spec.parse()).collect();
    let dataset = Dataset::open(&specs?, DataOptions::default())?;
    for round in 0..3 {
        let start = Instant::now();
        let mut by_source = vec![(0u32, 0.0f64); dataset.sources().len()];
        for i in 0..count {
            let began = Instant::now();
            let sample = dataset.sample(i, size);
            let spent = &mut by_source[sample.source];
            *spent = (spent.0 + 1, spent.1 + began.elapsed().as_secs_f64());
        }
        let ms = start.elapsed().as_secs_f64() * 1e3 / count as f64;
        println!("round {round}: {ms:.2} ms per pair");
        for (name, (n, seconds)) in dataset.sources().iter().zip(by_source) {
            println!(
                "  {name}: {:.2} ms ({n})",
                seconds * 1e3 / f64::from(n.max(1))
            );
        }
    }
    Ok(())
}
