//! Units in a loop, inputs held over each step.

use crate::{
    Given,
    units::{Outcome, Stepped, stepped},
};
use std::time::Instant;

struct Unit {
    fmu: Box<dyn Stepped>,
    read: Vec<u32>,
    values: Vec<f64>,
    sources: Vec<(usize, usize)>,
    set: Vec<u32>,
}

impl Unit {
    fn get(&mut self) -> Outcome<()> {
        if self.read.is_empty() { Ok(()) } else { self.fmu.get(&self.read, &mut self.values) }
    }
}

fn take(units: &mut [Unit], n: usize) -> Outcome<()> {
    let given: Vec<f64> = units[n].sources.iter().map(|&(u, place)| units[u].values[place]).collect();
    let unit = &mut units[n];
    if given.is_empty() { Ok(()) } else { unit.fmu.set(&unit.set, &given) }
}

fn play(given: &Given, units: &mut [Unit], step: usize) -> Outcome<()> {
    for (reference, values) in &given.inputs {
        units[0].fmu.set(&[*reference], &[values[step]])?;
    }
    Ok(())
}

pub fn run(given: &Given) -> Outcome<(f64, Vec<Vec<f64>>)> {
    let mut units = Vec::new();
    for (name, path, read) in &given.units {
        let (fmu, values) = (stepped(name, path)?, vec![0.0; read.len()]);
        units.push(Unit { fmu, read: read.clone(), values, sources: vec![], set: vec![] });
    }
    for &(source, place, sink, reference) in &given.wires {
        units[sink].sources.push((source, place));
        units[sink].set.push(reference);
    }
    play(given, &mut units, 0)?;
    for _ in 0..=units.len() {
        // initial values reach the end of the longest chain
        for unit in &mut units {
            unit.get()?;
        }
        for n in 0..units.len() {
            take(&mut units, n)?;
        }
    }
    for unit in &mut units {
        unit.fmu.initialized()?;
    }

    let mut rows = Vec::with_capacity(given.count + 1);
    if given.alone.is_some() {
        units[0].get()?;
        rows.push(units[0].values.clone());
    }
    let begun = Instant::now();
    for step in 0..given.count {
        play(given, &mut units, step)?;
        if !given.sequential {
            for n in 0..units.len() {
                take(&mut units, n)?;
            }
        }
        for n in 0..units.len() {
            if given.sequential {
                take(&mut units, n)?;
            }
            units[n].fmu.step(step as f64 * given.step, given.step)?;
            if given.sequential {
                units[n].get()?;
            }
        }
        if !given.sequential {
            for unit in &mut units {
                unit.get()?;
            }
        }
        rows.push(given.records.iter().map(|&(u, place)| units[u].values[place]).collect());
    }
    let seconds = begun.elapsed().as_secs_f64();
    for unit in &mut units {
        unit.fmu.end()?;
    }
    Ok((seconds, rows))
}
