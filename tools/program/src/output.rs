//! Outputs that never destroy an input, and files that replace others only when they are good.

use std::ffi::OsString;
use std::fmt::{self, Display};
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// An output that would overwrite an input or another output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clash {
    option: String,
    output: PathBuf,
    problem: String,
}

impl Display for Clash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Clash {
            option,
            output,
            problem,
        } = self;
        let output = output.display();
        write!(f, "{option}: {output} {problem}; nothing was written")
    }
}

impl std::error::Error for Clash {}

/// Refuses outputs that would destroy what is read.
///
/// `outputs` are options with their values; `inputs` are files and folders, `-` being standard
/// input. An output must not be an input file, by whatever path or link; it must not be an input
/// folder, lie directly in one, or be a link to a file in one; and two outputs must not be the same
/// file. Inputs that do not exist, such as URLs, protect nothing.
///
/// # Errors
/// Names the first output that clashes. Nothing has been written then.
pub fn check_outputs(outputs: &[(&str, &Path)], inputs: &[&Path]) -> Result<(), Clash> {
    for (i, &(option, output)) in outputs.iter().enumerate() {
        let clash = |problem: String| Clash {
            option: option.into(),
            output: output.into(),
            problem,
        };
        for &input in inputs {
            if let Some(problem) = clash_with(output, input) {
                return Err(clash(problem));
            }
        }
        for &(other, path) in &outputs[..i] {
            if is_same(output, path) {
                return Err(clash(format!("is the output of {other} as well")));
            }
        }
    }
    Ok(())
}

/// How an output would harm an input.
fn clash_with(output: &Path, input: &Path) -> Option<String> {
    let input = if input == Path::new("-") {
        Path::new("/dev/stdin")
    } else {
        input
    };
    let found = fs::metadata(input).ok()?;
    let name = input.display();
    if is_same(output, input) && (found.is_file() || found.is_dir()) {
        return Some(format!("is the input {name}"));
    }
    if !found.is_dir() {
        return None;
    }
    let is_inside = place(output)
        .is_some_and(|path| path.parent().map(Path::to_path_buf) == fs::canonicalize(input).ok());
    if is_inside && !fs::metadata(output).is_ok_and(|output| output.is_dir()) {
        return Some(format!("lies in the input folder {name}"));
    }
    // A hard link elsewhere to one of the folder's files.
    let output = fs::metadata(output).ok().filter(Metadata::is_file)?;
    let entries = fs::read_dir(input).ok()?;
    for entry in entries.flatten() {
        let path = entry.path();
        if fs::metadata(&path).is_ok_and(|file| is_same_file(&output, &file)) {
            return Some(format!("is a link to the input {}", path.display()));
        }
    }
    None
}

/// Whether two paths lead to the same place.
fn is_same(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (fs::metadata(a), fs::metadata(b))
        && is_same_file(&a, &b)
    {
        return true;
    }
    place(a).is_some_and(|a| Some(a) == place(b))
}

#[cfg(unix)]
fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// Other systems tell no file numbers: there, paths decide alone.
#[cfg(not(unix))]
fn is_same_file(_: &Metadata, _: &Metadata) -> bool {
    false
}

/// Where a path leads, with all links resolved, whether or not a file is there yet.
fn place(path: &Path) -> Option<PathBuf> {
    if let Ok(found) = fs::canonicalize(path) {
        return Some(found);
    }
    let target = target(path);
    let folder = match target.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    Some(fs::canonicalize(folder).ok()?.join(target.file_name()?))
}

/// The file that a path names: the end of its links, even where that does not exist yet.
fn target(path: &Path) -> PathBuf {
    const MOST_LINKS: usize = 40; // as many as Linux follows
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(next) = fs::read_link(&target) else {
            break;
        };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    target
}

/// A file that is written beside its place and takes it when [`keep`](Self::keep) is called.
///
/// Dropped before that, it leaves whatever was in its place untouched. Devices and pipes are
/// written to directly. The name beside begins with a dot, so that no reader of folders takes it
/// for a frame, and has the extension of the file's own name.
#[derive(Debug)]
pub struct NewFile {
    file: File,
    part: Option<PathBuf>, // none once it is in its place
    place: PathBuf,
}

impl NewFile {
    /// Opens the file for writing.
    ///
    /// # Errors
    /// If its folder does not exist or cannot be written, or if a folder or a write-protected file
    /// is in its place.
    pub fn create(path: &Path) -> io::Result<NewFile> {
        let place = target(path);
        let old = fs::metadata(&place).ok();
        match &old {
            Some(old) if old.is_dir() => {
                return Err(io::Error::new(ErrorKind::IsADirectory, "is a folder"));
            }
            Some(old) if !old.is_file() => {
                let file = File::options().write(true).open(&place)?;
                let part = None;
                return Ok(NewFile { file, part, place });
            }
            Some(_) => {
                // A protected file is not replaced, though its folder would allow it.
                File::options().write(true).open(&place)?;
            }
            None => {}
        }
        let part = beside(&place)?;
        let file = File::create(&part)?;
        if let Some(old) = old {
            // A file system without permissions keeps its own.
            let _ = fs::set_permissions(&part, old.permissions());
        }
        let part = Some(part);
        Ok(NewFile { file, part, place })
    }

    /// The path that is written to until the file is kept, for encoders that open it themselves.
    pub fn path(&self) -> &Path {
        self.part.as_deref().unwrap_or(&self.place)
    }

    /// Puts the file in its place; what is written later goes there as well. A no-op the second
    /// time.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn keep(&mut self) -> io::Result<()> {
        if let Some(part) = &self.part {
            fs::rename(part, &self.place)?;
            self.part = None;
        }
        Ok(())
    }

    /// Writes a whole file at once.
    ///
    /// # Errors
    /// As [`create`](Self::create), or if the system refuses the bytes.
    pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = NewFile::create(path)?;
        file.write_all(bytes)?;
        file.keep()
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            let _ = fs::remove_file(part); // an encoder may not have made it
        }
    }
}

/// A name in the same folder that no other program has.
fn beside(place: &Path) -> io::Result<PathBuf> {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    let (Some(stem), number) = (place.file_stem(), NUMBER.fetch_add(1, Ordering::Relaxed)) else {
        return Err(io::Error::new(ErrorKind::InvalidInput, "is no file name"));
    };
    let mut name = OsString::from(".");
    name.push(stem);
    name.push(format!(".{}-{number}.part", std::process::id()));
    if let Some(extension) = place.extension() {
        name.push(".");
        name.push(extension);
    }
    Ok(place.with_file_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fresh folder that holds `seq/1.jpg`, `seq/2.jpg` and `clip.mp4`.
    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("program-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("seq/drawn")).unwrap();
        fs::create_dir_all(folder.join("other")).unwrap();
        for file in ["seq/1.jpg", "seq/2.jpg", "clip.mp4"] {
            fs::write(folder.join(file), file).unwrap();
        }
        folder
    }

    #[test]
    fn output_that_is_an_input_is_refused() {
        let folder = folder("clash");
        #[cfg(unix)]
        {
            use std::os::unix::fs::symlink;
            fs::hard_link(folder.join("clip.mp4"), folder.join("hard.mp4")).unwrap();
            fs::hard_link(folder.join("seq/2.jpg"), folder.join("other/2.jpg")).unwrap();
            symlink("clip.mp4", folder.join("soft.mp4")).unwrap();
            symlink("seq", folder.join("soft")).unwrap();
            symlink("seq/new.txt", folder.join("dangling.txt")).unwrap();
        }
        let cases = [
            ("clip.mp4", "clip.mp4", true),
            ("other/../clip.mp4", "clip.mp4", true),
            ("boxes.txt", "clip.mp4", false),
            ("seq", "seq", true),
            ("seq/1.jpg", "seq", true),
            ("seq/boxes.txt", "seq", true),
            ("seq/1.jpg", "seq/1.jpg", true),
            ("seq/drawn", "seq", false),
            ("seq/drawn/1.jpg", "seq", false),
            ("other", "seq", false),
            ("new/boxes.txt", "seq", false),
            ("clip.mp4", "rtsp://host/clip.mp4", false),
        ];
        #[cfg(unix)]
        let links = [
            ("hard.mp4", "clip.mp4", true),
            ("clip.mp4", "hard.mp4", true),
            ("soft.mp4", "clip.mp4", true),
            ("soft", "seq", true),
            ("soft/boxes.txt", "seq", true),
            ("dangling.txt", "seq", true),
            ("other/2.jpg", "seq", true),
            ("other/2.jpg", "seq/1.jpg", false),
        ];
        #[cfg(not(unix))]
        let links = [];

        for (output, input, refused) in cases.into_iter().chain(links) {
            let found = check_outputs(&[("--out", &folder.join(output))], &[&folder.join(input)]);
            assert_eq!(found.is_err(), refused, "{output} from {input}: {found:?}");
        }
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn two_outputs_of_one_name_are_refused() {
        let folder = folder("twice");
        let (a, b) = (folder.join("a.gif"), folder.join("other/../a.gif"));

        let clash = check_outputs(&[("--out", &a), ("--overlay", &b)], &[]).unwrap_err();

        let text = clash.to_string();
        assert!(
            text.starts_with("--overlay: ") && text.contains("of --out"),
            "{text}"
        );
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn new_file_dropped_early_leaves_the_old_one() {
        let folder = folder("dropped");
        let path = folder.join("clip.mp4");

        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        assert_eq!(file.path().extension(), path.extension());
        drop(file);

        assert_eq!(fs::read(&path).unwrap(), b"clip.mp4");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 3, "a part is left");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn new_file_that_is_kept_replaces_the_old_one() {
        let folder = folder("kept");
        let path = folder.join("clip.mp4");

        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"first,").unwrap();
        file.keep().unwrap();
        file.write_all(b"second").unwrap();
        file.keep().unwrap();
        drop(file);

        assert_eq!(fs::read(&path).unwrap(), b"first,second");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 3, "a part is left");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn new_file_through_a_link_keeps_the_link() {
        let folder = folder("link");
        let link = folder.join("link.txt");
        std::os::unix::fs::symlink("other/real.txt", &link).unwrap();

        NewFile::write(&link, b"text").unwrap();

        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(folder.join("other/real.txt")).unwrap(), b"text");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn new_file_in_an_impossible_place_is_an_error() {
        let folder = folder("impossible");

        for path in ["seq", "clip.mp4/boxes.txt", "no/boxes.txt"] {
            assert!(NewFile::write(&folder.join(path), b"").is_err(), "{path}");
        }
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn write_protected_file_is_replaced_only_where_it_could_be_written() {
        let folder = folder("protected");
        let path = folder.join("protected.txt");
        fs::write(&path, "mine").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        let is_writable = File::options().write(true).open(&path).is_ok(); // by root

        let written = NewFile::write(&path, b"new");

        assert_eq!(written.is_ok(), is_writable);
        let expected: &[u8] = if is_writable { b"new" } else { b"mine" };
        assert_eq!(fs::read(&path).unwrap(), expected);
        fs::remove_dir_all(&folder).unwrap();
    }
}
