//! The loops that users of the crate `fmi` write. Arguments: a file that says what to run, a file for the results.
//!
//!     unit NAME PATH REFERENCE...      in stepping order; of what is read
//!     wire UNIT PLACE UNIT REFERENCE   the source's place is among what it reads
//!     record UNIT PLACE
//!     run STEP COUNT SCHEME            s; Jacobi or Gauss-Seidel
//!     alone KIND STATES INDICATORS     in place of `run`, one unit: CoSimulation or ModelExchange
//!     input REFERENCE VALUE...         of it, at every step's begin and at the end
//!
//! The results are rows of little-endian doubles, one per recorded output, after every step and, of a unit alone, before
//! the first; printed are the loop's seconds.

mod couple;
mod exchange;
mod units;

use std::{collections::HashMap, error::Error, fs, io::Write};

/// What the file says.
#[derive(Default)]
pub struct Given {
    pub units: Vec<(String, String, Vec<u32>)>,
    pub wires: Vec<(usize, usize, usize, u32)>,
    pub records: Vec<(usize, usize)>,
    pub step: f64,
    pub count: usize,
    pub sequential: bool,
    pub alone: Option<(String, usize, usize)>,
    pub inputs: Vec<(u32, Vec<f64>)>,
}

fn read(text: &str) -> Result<Given, Box<dyn Error>> {
    let mut given = Given::default();
    let mut index = HashMap::new();
    for line in text.lines() {
        let word: Vec<&str> = line.split('\t').collect();
        match word[0] {
            "unit" => {
                index.insert(word[1].to_owned(), given.units.len());
                let read = word[3..].iter().map(|r| r.parse()).collect::<Result<_, _>>()?;
                given.units.push((word[1].to_owned(), word[2].to_owned(), read));
            }
            "wire" => given.wires.push((index[word[1]], word[2].parse()?, index[word[3]], word[4].parse()?)),
            "record" => given.records.push((index[word[1]], word[2].parse()?)),
            "alone" => given.alone = Some((word[1].to_owned(), word[2].parse()?, word[3].parse()?)),
            "input" => {
                let values = word[2..].iter().map(|v| v.parse()).collect::<Result<_, _>>()?;
                given.inputs.push((word[1].parse()?, values));
            }
            _ => {
                (given.step, given.count) = (word[1].parse()?, word[2].parse()?);
                given.sequential = word[3] == "Gauss-Seidel";
            }
        }
    }
    Ok(given)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let given = read(&fs::read_to_string(&arguments[1])?)?;
    let (seconds, rows) = match &given.alone {
        Some((kind, states, indicators)) if kind == "ModelExchange" => exchange::run(&given, *states, *indicators)?,
        _ => couple::run(&given)?,
    };
    println!("{seconds}");
    let mut file = std::io::BufWriter::new(fs::File::create(&arguments[2])?);
    for value in rows.iter().flatten() {
        file.write_all(&value.to_le_bytes())?;
    }
    Ok(())
}
