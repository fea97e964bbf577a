//! Large values that are shared by all that hold equal ones.

use std::sync::{Arc, Mutex, PoisonError, Weak};

/// The values of a type that somebody holds: missions of a sweep that read the same file share what they read.
#[derive(Debug)]
pub(crate) struct SharedValues<T>(Mutex<Vec<Weak<T>>>);

impl<T> SharedValues<T> {
    /// None.
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// `value`, or the value for which `is_equal` is true, if somebody holds one.
    pub(crate) fn share(&self, value: T, is_equal: impl Fn(&T, &T) -> bool) -> Arc<T> {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.retain(|known| known.strong_count() > 0);
        if let Some(known) = held.iter().filter_map(Weak::upgrade).find(|known| is_equal(known, &value)) {
            return known;
        }
        let shared = Arc::new(value);
        held.push(Arc::downgrade(&shared));
        shared
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_are_one_as_long_as_somebody_holds_them() {
        static NAMES: SharedValues<String> = SharedValues::new();
        let share = |name: &str| NAMES.share(name.to_owned(), String::eq);
        let [first, other, again] = ["a", "b", "a"].map(share);
        assert!(Arc::ptr_eq(&first, &again) && !Arc::ptr_eq(&first, &other));
        let freed = Arc::downgrade(&other);
        drop(other);
        assert!(freed.upgrade().is_none(), "nobody holds it");
        assert_eq!(*share("b"), "b");
        assert_eq!(NAMES.0.lock().unwrap().len(), 2, "what nobody holds is forgotten");
    }
}
