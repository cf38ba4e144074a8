//! The library as its users have it: installed, found by pkg-config or CMake, under a sanitizer.
#![cfg(unix)]

mod common;

use common::{follows, has, library, source};
use std::path::{Path, PathBuf};
use std::process::Command;

const C: [&str; 5] = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror"];
const CPP: [&str; 5] = ["c++", "-std=c++11", "-Wall", "-Wextra", "-Werror"];
const SANITIZED: [&str; 3] = [
    "-g",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=undefined",
];

/// A prefix with the library of this build, and its folder of libraries.
struct Installed {
    prefix: PathBuf,
    libraries: PathBuf,
}

/// Installs the library to a new prefix; `None` if a part of the kit is missing.
fn installed(name: &str, libdir: &str) -> Option<Installed> {
    let library = library()?;
    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&prefix).ok();
    run(Command::new("bash")
        .arg(source("install.sh"))
        .arg(&prefix)
        .env("TRACK_CPU_LIBRARY", library)
        .env("LIBDIR", libdir)
        .env_remove("DESTDIR"));
    let libraries = prefix.join(libdir);
    Some(Installed { prefix, libraries })
}

/// What a program prints; it must succeed.
fn run(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {text}{told}");
    text
}

impl Installed {
    /// Compiles a program with what pkg-config says.
    fn compile(&self, compiler: [&str; 5], options: &[&str], file: &str) -> PathBuf {
        let flags = run(Command::new("pkg-config")
            .args(["--cflags", "--libs", "track_cpu"])
            .env("PKG_CONFIG_PATH", self.libraries.join("pkgconfig")));
        let program = self.prefix.join(file.replace(['/', '.'], "_"));
        run(Command::new(compiler[0])
            .args(&compiler[1..])
            .args(["-pedantic", "-pthread"])
            .args(options)
            .arg(source(file))
            .args(flags.split_whitespace())
            .arg("-o")
            .arg(&program));
        program
    }

    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("LD_LIBRARY_PATH", &self.libraries);
        command.env("DYLD_LIBRARY_PATH", &self.libraries);
        command
    }
}

#[test]
fn examples_built_by_pkg_config_give_the_boxes_of_rust() {
    if !has("cc") || !has("c++") || !has("pkg-config") {
        return;
    }
    let Some(installed) = installed("prefix", "lib") else {
        return;
    };
    for (compiler, file) in [(C, "examples/follow.c"), (CPP, "examples/follow.cpp")] {
        let program = installed.compile(compiler, &[], file);
        follows(&mut installed.command(&program));
    }
}

#[test]
fn interface_under_the_address_sanitizer_is_clean() {
    if !has("cc") || !has("c++") || !has("pkg-config") {
        return;
    }
    let Some(installed) = installed("sanitized", "lib") else {
        return;
    };
    for (compiler, file) in [(C, "tests/interface.c"), (CPP, "tests/interface.cpp")] {
        let probe = Command::new(compiler[0])
            .args(SANITIZED)
            .args(["-x", "c", "/dev/null", "-c", "-o", "/dev/null"])
            .output();
        if !probe.is_ok_and(|output| output.status.success()) {
            println!("skipped: {} has no address sanitizer", compiler[0]);
            return;
        }
        let program = installed.compile(compiler, &SANITIZED, file);
        let text = run(&mut installed.command(&program));
        assert_eq!(text, "passed\n");
    }
}

#[test]
fn examples_built_by_cmake_give_the_boxes_of_rust() {
    if !has("cc") || !has("c++") || !has("cmake") {
        return;
    }
    let Some(installed) = installed("multiarch", "lib/here") else {
        return;
    };
    let build = installed.prefix.join("build");
    let found = installed.libraries.join("cmake");
    run(Command::new("cmake")
        .arg("-S")
        .arg(source("examples"))
        .arg("-B")
        .arg(&build)
        .arg(format!("-DCMAKE_PREFIX_PATH={}", found.display())));
    run(Command::new("cmake").arg("--build").arg(&build));
    for program in ["follow_c", "follow_cpp"] {
        follows(&mut Command::new(build.join(program)));
    }
}

#[test]
fn cmake_asked_for_another_major_version_refuses() {
    if !has("cmake") {
        return;
    }
    let Some(installed) = installed("refused", "lib") else {
        return;
    };
    let project = installed.prefix.join("project");
    std::fs::create_dir_all(&project).unwrap();
    let text = "cmake_minimum_required(VERSION 3.16)\nproject(p LANGUAGES NONE)\n\
                find_package(track_cpu ${WANTED} REQUIRED)\n";
    std::fs::write(project.join("CMakeLists.txt"), text).unwrap();
    for (wanted, is_found) in [("1", true), ("1.0", true), ("1.99", false), ("2.0", false)] {
        let output = Command::new("cmake")
            .arg("-S")
            .arg(&project)
            .arg("-B")
            .arg(project.join(wanted))
            .arg(format!(
                "-DCMAKE_PREFIX_PATH={}",
                installed.prefix.display()
            ))
            .arg(format!("-DWANTED={wanted}"))
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.success(), is_found, "{wanted}: {told}");
    }
}
