//! Results that are written, shown or sent only because that was asked for.

use std::path::{Path, PathBuf};

use anyhow::Result;

use super::annotate::Annotator;
use super::candidate_rows::CandidateRows;
use super::particle_rows::ParticleRows;
use super::recorder::Recorder;
use super::sender::Sender;
use super::watch::WatchSink;
use super::{Annotate, Options, Output, Sink};
use crate::scene::OpenScene;

/// What takes results only because it was asked for. A failure of one does not end the run.
pub(super) struct Extras {
    candidate_rows: Option<CandidateRows>,
    annotator: Option<Annotator>,
    particle_rows: Option<ParticleRows>,
    recorder: Option<Recorder>,
    senders: Vec<Sender>,
    watched: Option<WatchSink>,
}

impl Extras {
    pub(super) fn create(scene_path: &Path, open: &OpenScene, options: &Options) -> Result<Self> {
        let scene = &open.scene;
        let folder = match &options.output {
            Output::Folder(folder) => Some(folder),
            Output::Stdout => None,
        };
        let annotated = folder.filter(|_| options.annotate != Annotate::No);
        let annotator = annotated.map(|folder| Annotator::create(folder, scene, options));
        let explained = folder.filter(|_| options.explain);
        let candidate_rows = explained.map(|folder| CandidateRows::create(folder, scene));
        let particles = options.particles.as_ref();
        let particle_rows = particles.map(|path| ParticleRows::create(path, scene));
        let recorder = options
            .mcap
            .as_ref()
            .map(|path| Recorder::create(path, scene));
        let senders = options.send.iter().map(|to| Sender::start(to, scene));
        let watch = options.watch.as_ref();
        Ok(Self {
            annotator: annotator.transpose()?,
            candidate_rows: candidate_rows.transpose()?,
            particle_rows: particle_rows.transpose()?,
            recorder: recorder.transpose()?,
            senders: senders.collect::<Result<_>>()?,
            watched: watch
                .map(|watch| watch.sink(scene_path, scene, &open.tracker))
                .transpose()?,
        })
    }

    pub(super) fn sinks(&mut self) -> Vec<&mut dyn Sink> {
        fn sink<S: Sink>(sink: &mut S) -> &mut dyn Sink {
            sink
        }
        let sinks = [
            self.candidate_rows.as_mut().map(sink),
            self.annotator.as_mut().map(sink),
            self.particle_rows.as_mut().map(sink),
            self.recorder.as_mut().map(sink),
            self.watched.as_mut().map(sink),
        ];
        let senders = self.senders.iter_mut().map(sink);
        sinks.into_iter().flatten().chain(senders).collect()
    }

    /// Ends them. Returns what was sent, in words, the files, and whether the recording is complete.
    pub(super) fn finish(self, options: &Options) -> (Vec<String>, Vec<PathBuf>, Result<()>) {
        let sent = self.senders.into_iter().map(Sender::finish).collect();
        let candidates = self.candidate_rows.map(|rows| rows.path().to_owned());
        let annotated = self
            .annotator
            .map(|annotator| annotator.folder().to_owned());
        let files = candidates.into_iter().chain(annotated);
        let files = files
            .chain(options.particles.clone())
            .chain(options.mcap.clone());
        let recorded = self.recorder.map_or(Ok(()), Recorder::finish);
        (sent, files.collect(), recorded)
    }
}
