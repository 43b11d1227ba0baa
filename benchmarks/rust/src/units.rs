//! Instances of either version of FMI behind one small trait.

use fmi::{
    fmi2::{
        self,
        import::Fmi2Import,
        instance::{CoSimulation as _, Common as _},
    },
    fmi3::{self, CoSimulation as _, Fmi3Model as _, GetSet as _, import::Fmi3Import},
    import,
    schema::{MajorVersion, traits::FmiModelDescription as _},
    traits::FmiInstance,
};
use std::error::Error;

pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// Reals by their references.
pub trait Reals {
    fn get(&mut self, references: &[u32], values: &mut [f64]) -> Outcome<()>;
    fn set(&mut self, references: &[u32], values: &[f64]) -> Outcome<()>;
}

macro_rules! reals {
    ($instance:ty, $get:ident, $set:ident) => {
        impl Reals for $instance {
            fn get(&mut self, references: &[u32], values: &mut [f64]) -> Outcome<()> {
                self.$get(references, values)?;
                Ok(())
            }
            fn set(&mut self, references: &[u32], values: &[f64]) -> Outcome<()> {
                self.$set(references, values)?;
                Ok(())
            }
        }
    };
}
reals!(fmi2::instance::InstanceCS, get_real, set_real);
reals!(fmi2::instance::InstanceME, get_real, set_real);
reals!(fmi3::instance::InstanceCS, get_float64, set_float64);
reals!(fmi3::instance::InstanceME, get_float64, set_float64);

/// A unit that is stepped.
pub trait Stepped: Reals {
    fn step(&mut self, t: f64, h: f64) -> Outcome<()>;
    fn initialized(&mut self) -> Outcome<()>;
    fn end(&mut self) -> Outcome<()>;
}

impl Stepped for fmi2::instance::InstanceCS {
    fn step(&mut self, t: f64, h: f64) -> Outcome<()> {
        self.do_step(t, h, true)?;
        Ok(())
    }
    fn initialized(&mut self) -> Outcome<()> {
        FmiInstance::exit_initialization_mode(self)?;
        Ok(())
    }
    fn end(&mut self) -> Outcome<()> {
        FmiInstance::terminate(self)?;
        Ok(())
    }
}

impl Stepped for fmi3::instance::InstanceCS {
    fn step(&mut self, t: f64, h: f64) -> Outcome<()> {
        let (mut event, mut terminate, mut early, mut last) = (false, false, false, t);
        self.do_step(t, h, true, &mut event, &mut terminate, &mut early, &mut last)?;
        Ok(())
    }
    fn initialized(&mut self) -> Outcome<()> {
        FmiInstance::exit_initialization_mode(self)?;
        Ok(())
    }
    fn end(&mut self) -> Outcome<()> {
        FmiInstance::terminate(self)?;
        Ok(())
    }
}

pub fn is_fmi2(path: &str) -> Outcome<bool> {
    Ok(matches!(import::peek_descr_path(path)?.major_version()?, MajorVersion::FMI2))
}

/// In initialization mode. The import owns the unpacked files, so it lives as long as the program.
pub fn stepped(name: &str, path: &str) -> Outcome<Box<dyn Stepped>> {
    if is_fmi2(path)? {
        let opened: &Fmi2Import = Box::leak(Box::new(import::from_path(path)?));
        let mut unit = opened.instantiate_cs(name, false, false)?;
        FmiInstance::enter_initialization_mode(&mut unit, None, 0.0, None)?;
        return Ok(Box::new(unit));
    }
    let opened: &Fmi3Import = Box::leak(Box::new(import::from_path(path)?));
    let mut unit = opened.instantiate_cs(name, false, false, false, false, &[])?;
    FmiInstance::enter_initialization_mode(&mut unit, None, 0.0, None)?;
    Ok(Box::new(unit))
}
