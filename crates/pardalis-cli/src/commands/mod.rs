//! The commands of the program, one module each.

pub(crate) mod calibrate;
pub(crate) mod camera;
pub(crate) mod check;
pub(crate) mod demo;
pub(crate) mod devices;
pub(crate) mod evaluate;
pub(crate) mod init;
pub(crate) mod learn;
pub(crate) mod likelihood;
pub(crate) mod locate;
pub(crate) mod measure;
pub(crate) mod rectify;
pub(crate) mod run_report;
pub(crate) mod simulate;
pub(crate) mod studio;
pub(crate) mod track;
pub(crate) mod view;
