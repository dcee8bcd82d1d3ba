//! Integration tests of simulation, in one executable.

mod simulate;
