//! Baked trees kept on disk, so that a model is baked once. One `.treeline` file an entry, named by its key.
//!
//! Several processes may share a folder: entries appear whole (see [`file`](super::file)), equal keys mean equal
//! trees, and an entry that vanishes is baked again.

use super::file::{FileError, read_treeline, write_treeline};
use super::format::VERSION;
use super::tree_data::TreeData;
use bevy::log::warn;
use std::ffi::OsString;
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Version of the bake. Raise it when equal models and settings give other points or factors than before: it is part of
/// every key, so older entries are no longer found.
pub const BAKE_VERSION: u32 = 6;

/// The environment variable that names the cache folder.
pub const CACHE_DIR_VARIABLE: &str = "TREELINE_CACHE_DIR";

/// Where baked trees are kept between runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CacheLocation {
    /// [`CACHE_DIR_VARIABLE`] if set, else the user's cache folder.
    #[default]
    Default,
    /// This folder; it is made if need be.
    Folder(PathBuf),
    /// Nowhere: every start bakes again.
    Off,
}

/// A folder of baked trees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BakeCache {
    folder: PathBuf,
}

/// Name of an entry: a hash of everything that decides what a bake gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CacheKey([u8; 32]);

impl fmt::Display for CacheKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(blake3::Hash::from_bytes(self.0).to_hex().as_str())
    }
}

impl BakeCache {
    /// A cache in `folder`, which is created when first written to.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// The folder named by `TREELINE_CACHE_DIR`, else `bevy_treeline/trees` in the user's cache folder. `None` if the
    /// user has none.
    pub fn default_folder() -> Option<PathBuf> {
        choose_folder(std::env::var_os(CACHE_DIR_VARIABLE), dirs::cache_dir())
    }

    /// Where the entries lie.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The key of a model baked with these settings, given as the JSON of `BakeSettings`.
    ///
    /// `content_hash` is that of the model's bytes. Models that are not from a file have none (all zero), so they
    /// must not be cached by it.
    pub fn key(content_hash: &[u8; 32], settings_json: &str) -> CacheKey {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"bevy_treeline bake");
        hasher.update(&VERSION.to_le_bytes()).update(&BAKE_VERSION.to_le_bytes());
        // Of all parts only the last has no fixed length, so no two keys share their bytes.
        hasher.update(content_hash).update(settings_json.as_bytes());
        CacheKey(*hasher.finalize().as_bytes())
    }

    /// The file of an entry, there or not.
    pub fn path(&self, key: &CacheKey) -> PathBuf {
        self.folder.join(format!("{key}.treeline"))
    }

    /// The tree kept under `key`. An entry that cannot be read is a miss with a warning, and removed if it is damaged.
    pub fn get(&self, key: &CacheKey) -> Option<TreeData> {
        let error = match read_treeline(&self.path(key)) {
            Ok(tree) => return Some(tree),
            Err(FileError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
                return None;
            }
            Err(error) => error,
        };
        warn!("Baked tree ignored, so it is baked again: {error}");
        if !matches!(error, FileError::Io { .. }) {
            self.remove(key);
        }
        None
    }

    /// Keeps `tree` under `key`; an older entry is replaced. Returns the bytes written.
    ///
    /// # Errors
    /// As [`write_treeline`]. A cache that cannot be written costs time only: warn and go on.
    pub fn put(&self, key: &CacheKey, tree: &TreeData) -> Result<u64, FileError> {
        write_treeline(&self.path(key), tree)
    }

    /// Removes a damaged entry. Another process may have replaced it since; that costs one more bake.
    fn remove(&self, key: &CacheKey) {
        let path = self.path(key);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                warn!("Cannot remove {}: {error}; remove it yourself", path.display());
            }
            _ => {}
        }
    }
}

/// An empty variable counts as unset, as usual for folders (XDG Base Directory Specification).
fn choose_folder(variable: Option<OsString>, user_cache: Option<PathBuf>) -> Option<PathBuf> {
    match variable.filter(|folder| !folder.is_empty()) {
        Some(folder) => Some(folder.into()),
        None => user_cache.map(|folder| folder.join("bevy_treeline").join("trees")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::synthetic::synthetic_tree;
    use std::fs;

    fn cache() -> (tempfile::TempDir, BakeCache) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = BakeCache::new(folder.path().join("trees"));
        (folder, cache)
    }

    #[test]
    fn a_tree_is_found_by_its_model_and_settings_only() {
        let (_folder, cache) = cache();
        let key = BakeCache::key(&[1; 32], r#"{"seed":1}"#);
        assert_eq!(cache.get(&key), None);
        let tree = synthetic_tree(500, 1);
        cache.put(&key, &tree).expect("the folder is writable");
        assert_eq!(cache.get(&key), Some(tree));
        for other in [
            BakeCache::key(&[2; 32], r#"{"seed":1}"#),
            BakeCache::key(&[1; 32], r#"{"seed":2}"#),
            BakeCache::key(&[1; 32], ""),
        ] {
            assert_ne!(other, key);
            assert_eq!(cache.get(&other), None);
        }
        assert_eq!(key.to_string().len(), 64);
    }

    #[test]
    fn a_damaged_entry_is_a_miss_and_is_removed() {
        let (_folder, cache) = cache();
        let key = BakeCache::key(&[1; 32], "{}");
        let damage: [fn(&mut Vec<u8>); 3] =
            [Vec::clear, |bytes| bytes[200] ^= 1, |bytes| bytes.truncate(100)];
        for damage in damage {
            cache.put(&key, &synthetic_tree(500, 1)).expect("the folder is writable");
            let mut bytes = fs::read(cache.path(&key)).expect("just written");
            damage(&mut bytes);
            fs::write(cache.path(&key), bytes).expect("the folder is writable");
            assert_eq!(cache.get(&key), None);
            assert!(!cache.path(&key).exists());
        }
    }

    #[test]
    fn an_entry_that_is_no_file_is_a_miss() {
        let (_folder, cache) = cache();
        let key = BakeCache::key(&[1; 32], "{}");
        fs::create_dir_all(cache.path(&key)).expect("the folder is writable");
        assert_eq!(cache.get(&key), None);
        assert!(cache.put(&key, &synthetic_tree(10, 1)).is_err());
    }

    #[test]
    fn a_cache_that_cannot_be_written_is_an_error_and_a_miss() {
        let (folder, _) = cache();
        let file = folder.path().join("file");
        fs::write(&file, "").expect("the folder is writable");
        let cache = BakeCache::new(file.join("trees"));
        let key = BakeCache::key(&[1; 32], "{}");
        assert!(cache.put(&key, &synthetic_tree(10, 1)).is_err());
        assert_eq!(cache.get(&key), None);
    }

    #[test]
    fn many_writers_and_readers_of_one_entry_see_whole_trees() {
        let (_folder, cache) = cache();
        let key = BakeCache::key(&[1; 32], "{}");
        let tree = synthetic_tree(2000, 1);
        cache.put(&key, &tree).expect("the folder is writable");
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        cache.put(&key, &tree).expect("the folder is writable");
                        assert_eq!(cache.get(&key).as_ref(), Some(&tree));
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(cache.folder()).expect("a folder").count(), 1);
    }

    #[test]
    fn the_variable_wins_over_the_users_cache_folder_unless_it_is_empty() {
        let user = Some(PathBuf::from("home"));
        let below = Some(PathBuf::from("home").join("bevy_treeline").join("trees"));
        assert_eq!(choose_folder(Some("x".into()), user.clone()), Some("x".into()));
        assert_eq!(choose_folder(Some("".into()), user.clone()), below);
        assert_eq!(choose_folder(None, user), below);
        assert_eq!(choose_folder(None, None), None);
    }
}
