//! The program, through its commands: one test program, so that it is linked once.

mod bad_input;
mod benchmark;
mod browser;
mod capture;
mod compare;
mod crop;
mod demo;
#[cfg(unix)]
mod elsewhere;
mod end_to_end;
mod eval;
#[cfg(unix)]
mod examples;
mod export;
mod following_light;
mod foreign;
mod glossy;
mod known_light;
mod lamps;
mod library;
mod light_network;
mod linear;
mod manifest;
mod origin;
mod pages;
mod place;
mod prefilter;
mod python;
mod reflections;
mod report;
mod resume;
mod several_lights;
mod site;
mod textured;
mod tiny;
mod view;
mod web;
