//! News of the processes, as the launcher and the viewer get them.

use skysink_ring::health::Health;

use crate::cursor::Cursor;

/// A message of any numbers means nothing, or says what it means in one line, and the same when it is sent on.
///
/// # Panics
/// If not.
pub fn health_message(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    while !input.is_empty() {
        let (process, fate) = (input.u32(), input.u32());
        let message = Health { process, fate, detail: input.u32().cast_signed(), reserved: input.u32() };
        if let Some((role, fate)) = message.decode() {
            super::assert_one_line(&fate);
            assert_eq!(Health::of(role, fate).decode(), Some((role, fate)), "{message:?}");
        }
    }
}
