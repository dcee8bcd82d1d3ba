//! Integration tests of the filters, in one executable.

mod bernoulli;
mod kalman;
