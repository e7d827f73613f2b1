//! SIGINT and SIGTERM: the first one interrupts the render, the second one ends the program. SIGUSR1 asks for the image
//! so far.

use crate::error::{Error, Result};
use crate::render::Progress;
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// A function that reports a signal before the first sample and returns the exit code for it.
pub type EarlyExit = Box<dyn Fn(i32) -> i32 + Send>;

/// The render that a signal interrupts.
struct Target {
    progress: Arc<Progress>,
    early: Option<EarlyExit>,
}

/// The first signal; 0 before.
static CAUGHT: AtomicI32 = AtomicI32::new(0);
/// The last render; `None` until there is one, and until the program listens.
static TARGET: Mutex<Option<Target>> = Mutex::new(None);

/// Returns the exit code of a program that a signal has stopped, if one has been caught: 128 more than the signal.
pub fn exit_code() -> Option<u8> {
    match CAUGHT.load(Ordering::Relaxed) {
        0 => None,
        signal => Some(u8::try_from(128 + signal).unwrap_or(u8::MAX)),
    }
}

/// Lets the first signal interrupt a render, instead of an earlier one. A signal before the first sample exits with the
/// code that `early` returns, because nothing is lost then.
///
/// # Errors
/// If the program cannot listen for signals.
pub fn interrupt(progress: &Arc<Progress>, early: Option<EarlyExit>) -> Result<()> {
    let target = Target { progress: progress.clone(), early };
    let older = TARGET.lock().unwrap_or_else(PoisonError::into_inner).replace(target);
    if older.is_none() {
        listen()?;
    }
    if exit_code().is_some() {
        progress.interrupt();
    }
    Ok(())
}

/// Stops the program as SIGINT does. Without a render yet, the program ends.
pub fn stop() {
    if TARGET.lock().unwrap_or_else(PoisonError::into_inner).is_none() {
        signal_hook::low_level::exit(128 + libc::SIGINT);
    }
    // If the system refuses, the render goes on, and a signal from outside can stop it.
    _ = signal_hook::low_level::raise(libc::SIGINT);
}

/// Keeps a request for the image so far from ending the program while there is no render that could answer it.
///
/// # Errors
/// If the program cannot listen for signals.
pub fn survive_requests() -> Result<()> {
    signal_hook::flag::register(libc::SIGUSR1, Arc::default())
        .map(|_| ())
        .map_err(|e| Error::internal(format!("cannot listen for signals: {e}")))
}

fn listen() -> Result<()> {
    let mut signals = signal_hook::iterator::Signals::new([libc::SIGINT, libc::SIGTERM, libc::SIGUSR1])
        .map_err(|e| Error::internal(format!("cannot listen for signals: {e}")))?;
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if signal == libc::SIGUSR1 {
                if let Some(target) = &*TARGET.lock().unwrap_or_else(PoisonError::into_inner) {
                    target.progress.request_preview();
                }
                continue;
            }
            if CAUGHT.swap(signal, Ordering::Relaxed) != 0 {
                signal_hook::low_level::exit(128 + signal);
            }
            let target = TARGET.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(Target { progress, early }) = &*target else { continue };
            if let Some(early) = early.as_ref().filter(|_| !progress.has_begun()) {
                // The preparation cannot be interrupted quickly, for example while a photon map is built.
                signal_hook::low_level::exit(early(signal));
            }
            progress.interrupt();
        }
    });
    Ok(())
}
