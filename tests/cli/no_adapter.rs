//! A machine without any Vulkan driver, made by hiding the drivers from the loader.

use super::Workplace;

const HIDDEN: [(&str, &str); 3] = [
    ("VK_ICD_FILENAMES", "/nonexistent.json"),
    ("VK_DRIVER_FILES", "/nonexistent.json"),
    ("WGPU_BACKEND", "vulkan"),
];

#[test]
#[cfg(target_os = "linux")]
fn without_an_adapter_pictures_fail_with_what_to_install() {
    let place = Workplace::new();
    for command in [
        "doctor",
        // Of all species, none of which is baked.
        "fly --headless --frames 1 --side 1km --out out",
        "compare {tree} --ldi 32 --out out",
        "bench --tree {tree} --ldi 32 --out out",
        "view {tree} --headless --ldi 32 --out out",
    ] {
        let run = place.run_with(command, &HIDDEN);
        run.fails_with(&["there is no GPU", "install a Vulkan driver", "mesa-vulkan-drivers"]);
        assert_eq!(place.files("out"), [""; 0], "{command}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn without_an_adapter_a_bake_takes_the_cpu_unless_the_gpu_was_asked_for() {
    let place = Workplace::new();
    let run =
        place.run_with("bake {tree} --ldi 64 --out out --json table.json", &HIDDEN).succeeds();
    assert!(run.err.contains("peeling on the CPU"), "{}", run.err);
    assert_eq!(place.json("table.json")["models"][0]["backend"], "cpu");
    assert_eq!(place.files("out"), ["spruce.treeline"]);

    let run = place.run_with("bake {tree} --ldi 64 --out gpu --peel gpu", &HIDDEN);
    run.fails_with(&["there is no GPU", "install a Vulkan driver"]);
    assert_eq!(place.files("gpu"), [""; 0]);
}
