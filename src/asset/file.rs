//! `.treeline` files on disk: written whole or not at all, never read beyond what a tree can take.

use super::format::{self, MAGIC};
use super::format_error::FormatError;
use super::tree_data::{TreeData, TreeDataError};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Longest file that is read: the largest tree does not compress at all, and something is left for optional sections.
const MAX_FILE_BYTES: u64 = 4 << 30;

/// Why a file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}; {advice}", path.display())]
    Io {
        /// What was tried, in words.
        action: &'static str,
        /// With which file or folder.
        path: PathBuf,
        /// The refusal.
        source: io::Error,
        /// What to do.
        advice: &'static str,
    },
    /// The file was read, but is no tree.
    #[error("cannot read {}: {source}", path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        source: FormatError,
    },
    /// The file is longer than any tree.
    #[error("cannot read {}: it is longer than 4 GiB; give a file that `treeline bake` wrote", path.display())]
    TooLong {
        /// Which file.
        path: PathBuf,
    },
    /// The tree cannot be read back, so it is not written.
    #[error("cannot write {}: {source}; bake it again with `treeline bake`", path.display())]
    Tree {
        /// Which file.
        path: PathBuf,
        /// What is wrong with the tree.
        source: TreeDataError,
    },
}

/// Writes `tree` to `path` and returns the bytes written. Creates the folder. Writes to a temporary file beside it
/// first and renames that, so that other programs see the old file or the new one, whole.
///
/// # Errors
/// The tree is not valid, or the folder or the file cannot be written. An old file is then left as it was.
pub fn write_treeline(path: &Path, tree: &TreeData) -> Result<u64, FileError> {
    tree.validate().map_err(|source| FileError::Tree { path: path.to_owned(), source })?;
    let failed = |action, path: &Path, advice| {
        let path = path.to_owned();
        move |source| FileError::Io { action, path, source, advice }
    };
    // A bare file name has the parent "".
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let advice = "give a path in a folder that you may write to";
    fs::create_dir_all(folder).map_err(failed("create the folder", folder, advice))?;
    let bytes = format::encode(tree);
    let mut file = temporary_file(folder).map_err(failed("write into", folder, advice))?;
    let advice = "check that the disk is not full";
    file.write_all(&bytes).map_err(failed("write", path, advice))?;
    let advice = "check that it is not a folder, and that no program keeps it open";
    file.persist(path).map_err(|error| failed("replace", path, advice)(error.error))?;
    Ok(bytes.len() as u64)
}

/// A temporary file that, renamed, is as readable to others as any new file of this user.
fn temporary_file(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".treeline-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Less the user's umask; a temporary file would be private by default.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// Reads the tree at `path`.
///
/// # Errors
/// The file cannot be read, or is no tree.
pub fn read_treeline(path: &Path) -> Result<TreeData, FileError> {
    let bytes = read_bytes(path).map_err(|source| FileError::Io {
        action: "read",
        path: path.to_owned(),
        source,
        advice: "check the path, or make the file with `treeline bake`",
    })?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(FileError::TooLong { path: path.to_owned() });
    }
    format::decode(&bytes).map_err(|source| FileError::Format { path: path.to_owned(), source })
}

/// The bytes of a file; only the first few if it is of another kind, and one too many if it is too long.
fn read_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    (&file).take(MAGIC.len() as u64).read_to_end(&mut bytes)?;
    if bytes == MAGIC {
        file.take(MAX_FILE_BYTES + 1 - bytes.len() as u64).read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::synthetic::synthetic_tree;

    #[test]
    fn a_tree_survives_the_disk_and_its_folder_is_made() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("new/deeper/oak.treeline");
        let tree = synthetic_tree(1000, 2);
        let bytes = write_treeline(&path, &tree).expect("the folder is writable");
        assert_eq!(fs::metadata(&path).expect("just written").len(), bytes);
        assert_eq!(read_treeline(&path).expect("just written"), tree);
        // Again, over the old file; nothing else is left in the folder.
        let other = synthetic_tree(10, 3);
        write_treeline(&path, &other).expect("an old file is replaced");
        assert_eq!(read_treeline(&path).expect("just written"), other);
        assert_eq!(fs::read_dir(path.parent().expect("deeper")).expect("a folder").count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_written_file_has_the_permissions_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (ours, plain) = (folder.path().join("a.treeline"), folder.path().join("plain"));
        write_treeline(&ours, &synthetic_tree(10, 1)).expect("the folder is writable");
        fs::write(&plain, "x").expect("the folder is writable");
        let mode = |path| fs::metadata(path).expect("just written").permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn a_path_below_a_file_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        fs::write(&file, "not a folder").expect("the folder is writable");
        let path = file.join("oak.treeline");
        let error = write_treeline(&path, &synthetic_tree(10, 1)).expect_err("no folder there");
        let text = error.to_string();
        assert!(matches!(error, FileError::Io { .. }));
        assert!(
            text.contains(&file.display().to_string()) && text.contains("give a path"),
            "{text}"
        );
        let text = read_treeline(&path).expect_err("nothing there").to_string();
        assert!(text.contains("oak.treeline") && text.contains("treeline bake"), "{text}");
    }

    #[test]
    fn a_folder_in_the_place_of_the_file_stays() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("oak.treeline");
        fs::create_dir(&path).expect("the folder is writable");
        let error = write_treeline(&path, &synthetic_tree(10, 1)).expect_err("a folder is there");
        assert!(error.to_string().contains("replace"), "{error}");
        assert!(read_treeline(&path).is_err());
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }

    #[test]
    fn an_invalid_tree_leaves_the_old_file_as_it_was() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("oak.treeline");
        let tree = synthetic_tree(10, 1);
        write_treeline(&path, &tree).expect("the folder is writable");
        let broken = TreeData { pixel: 0.0, ..tree.clone() };
        let error = write_treeline(&path, &broken).expect_err("a pixel of 0");
        assert!(matches!(error, FileError::Tree { .. }));
        assert_eq!(read_treeline(&path).expect("the old one"), tree);
    }

    #[test]
    fn another_kind_of_file_is_named_as_such() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("oak.glb");
        fs::write(&path, b"glTF\x02\0\0\0 and more").expect("the folder is writable");
        let text = read_treeline(&path).expect_err("a model").to_string();
        assert!(text.contains("oak.glb") && text.contains("glTF\\x02"), "{text}");
    }
}
