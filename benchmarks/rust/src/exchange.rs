//! One unit whose states a Runge-Kutta method integrates, inputs linear between rows, events located by bisection.

use crate::{
    Given,
    units::{Outcome, Reals, is_fmi2},
};
use fmi::{
    EventFlags,
    fmi2::import::Fmi2Import,
    fmi3::{Fmi3Model as _, import::Fmi3Import},
    import,
    traits::{FmiInstance, FmiModelExchange},
};
use std::time::Instant;

const PARTS: usize = 2; // of a step
const HALVINGS: usize = 40;

struct Exchanged<'a, I> {
    unit: I,
    given: &'a Given,
    t: f64,
    x: Vec<f64>,
    z: Vec<f64>,
    next_event: f64,
}

fn said<T, E: std::fmt::Debug>(result: Result<T, E>, call: &str) -> Outcome<T> {
    result.map_err(|why| format!("{call}: {why:?}").into())
}

impl<I: FmiModelExchange + Reals> Exchanged<'_, I> {
    fn inputs(&mut self, t: f64) -> Outcome<()> {
        let row = ((t / self.given.step) as usize).min(self.given.count - 1);
        let part = t / self.given.step - row as f64;
        for (reference, values) in &self.given.inputs {
            self.unit.set(&[*reference], &[values[row] + part * (values[row + 1] - values[row])])?;
        }
        Ok(())
    }

    fn at(&mut self, t: f64, x: &[f64]) -> Outcome<()> {
        said(self.unit.set_time(t), "set_time")?;
        self.inputs(t)?;
        if x.is_empty() {
            return Ok(());
        }
        said(self.unit.set_continuous_states(x), "set_continuous_states")?;
        Ok(())
    }

    fn slope(&mut self, t: f64, x: &[f64]) -> Outcome<Vec<f64>> {
        self.at(t, x)?;
        let mut slope = vec![0.0; x.len()];
        said(self.unit.get_continuous_state_derivatives(&mut slope), "get_continuous_state_derivatives")?;
        Ok(slope)
    }

    fn indicators(&mut self, t: f64, x: &[f64]) -> Outcome<Vec<f64>> {
        self.at(t, x)?;
        let mut z = vec![0.0; self.z.len()];
        if !z.is_empty() {
            said(self.unit.get_event_indicators(&mut z), "get_event_indicators")?;
        }
        Ok(z)
    }

    /// Kutta 1901: the states after h.
    fn stepped(&mut self, h: f64) -> Outcome<Vec<f64>> {
        let (t, x) = (self.t, self.x.clone());
        let ahead = |h: f64, k: &[f64]| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + h * k).collect() };
        let k1 = self.slope(t, &x)?;
        let k2 = self.slope(t + h / 2.0, &ahead(h / 2.0, &k1))?;
        let k3 = self.slope(t + h / 2.0, &ahead(h / 2.0, &k2))?;
        let k4 = self.slope(t + h, &ahead(h, &k3))?;
        let mean: Vec<f64> = (0..x.len()).map(|i| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0).collect();
        Ok(ahead(h, &mean))
    }

    fn meets(&self, z: &[f64]) -> bool {
        self.z.iter().zip(z).any(|(before, after)| *before < 0.0 && *after > 0.0)
    }

    /// A time shortly behind the first indicator that turns positive, and the states there.
    fn first_event(&mut self, mut to: f64) -> Outcome<(f64, Vec<f64>)> {
        let mut before = self.t;
        for _ in 0..HALVINGS {
            let middle = (before + to) / 2.0;
            if !(before < middle && middle < to) {
                break;
            }
            let x = self.stepped(middle - self.t)?;
            let z = self.indicators(middle, &x)?;
            if self.meets(&z) { to = middle } else { before = middle }
        }
        Ok((to, self.stepped(to - self.t)?))
    }

    /// In event mode when it is called, in continuous-time mode behind it.
    fn event(&mut self) -> Outcome<()> {
        loop {
            let mut flags = EventFlags::default();
            said(self.unit.update_discrete_states(&mut flags), "update_discrete_states")?;
            self.next_event = flags.next_event_time.unwrap_or(f64::INFINITY);
            if !flags.discrete_states_need_update {
                break;
            }
        }
        said(self.unit.enter_continuous_time_mode(), "enter_continuous_time_mode")?;
        if !self.x.is_empty() {
            said(self.unit.get_continuous_states(&mut self.x), "get_continuous_states")?;
        }
        let (t, x) = (self.t, self.x.clone());
        self.z = self.indicators(t, &x)?;
        Ok(())
    }

    fn run(&mut self, end: f64) -> Outcome<()> {
        while self.t < end {
            let mut to = end.min(self.t + self.given.step / PARTS as f64).min(self.next_event);
            let mut x = self.stepped(to - self.t)?;
            let mut z = self.indicators(to, &x)?;
            let met = self.meets(&z);
            if met {
                (to, x) = self.first_event(to)?;
                z = self.indicators(to, &x)?;
            }
            (self.t, self.x, self.z) = (to, x, z);
            let (mut event, mut terminate) = (false, false);
            said(self.unit.completed_integrator_step(true, &mut event, &mut terminate), "completed_integrator_step")?;
            if met || event || self.t >= self.next_event {
                said(self.unit.enter_event_mode(), "enter_event_mode")?;
                self.event()?;
            }
        }
        Ok(())
    }
}

fn integrate<I: FmiModelExchange + Reals>(
    mut unit: I,
    given: &Given,
    states: usize,
    indicators: usize,
) -> Outcome<Vec<Vec<f64>>> {
    said(FmiInstance::enter_initialization_mode(&mut unit, None, 0.0, None), "enter_initialization_mode")?;
    for (reference, values) in &given.inputs {
        unit.set(&[*reference], &values[..1])?;
    }
    said(FmiInstance::exit_initialization_mode(&mut unit), "exit_initialization_mode")?;
    let (x, z) = (vec![0.0; states], vec![0.0; indicators]);
    let mut exchanged = Exchanged { unit, given, t: 0.0, x, z, next_event: f64::INFINITY };
    exchanged.event()?;
    let read = &given.units[0].2;
    let mut rows = Vec::with_capacity(given.count + 1);
    for k in 0..=given.count {
        exchanged.run(k as f64 * given.step)?;
        let mut row = vec![0.0; read.len()];
        exchanged.unit.get(read, &mut row)?;
        rows.push(row);
    }
    said(FmiInstance::terminate(&mut exchanged.unit), "terminate")?;
    Ok(rows)
}

pub fn run(given: &Given, states: usize, indicators: usize) -> Outcome<(f64, Vec<Vec<f64>>)> {
    let (name, path, _) = &given.units[0];
    let begun = Instant::now();
    let rows = if is_fmi2(path)? {
        let opened: Fmi2Import = import::from_path(path)?;
        integrate(opened.instantiate_me(name, false, false)?, given, states, indicators)?
    } else {
        let opened: Fmi3Import = import::from_path(path)?;
        integrate(opened.instantiate_me(name, false, false)?, given, states, indicators)?
    };
    Ok((begun.elapsed().as_secs_f64(), rows))
}
