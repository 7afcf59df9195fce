//! Generates the private dialects' Rust code from `message_definitions/`: the pair link's and the radio's.

fn main() {
    println!("cargo:rerun-if-changed=message_definitions");
    #[cfg(feature = "companion")]
    generate();
}

#[cfg(feature = "companion")]
fn generate() {
    // The generated mod.rs hides each dialect behind a feature of its name; ours are always wanted.
    println!("cargo:rustc-cfg=feature=\"dialect-veilwing\"");
    println!("cargo:rustc-cfg=feature=\"dialect-veilwing_radio\"");
    let out = std::path::PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default());
    // Each in a directory of its own: every room includes its dialect alone.
    for (room, xml) in [("pair", "veilwing.xml"), ("transmitter", "veilwing_radio.xml")] {
        let path = format!("message_definitions/{xml}");
        let out = out.join(room);
        if let Err(error) = std::fs::create_dir_all(&out) {
            println!("cargo::error={}: {error}", out.display());
        }
        let xml = mavlink_bindgen::XmlDefinitions::Files(vec![path.as_str()]);
        if let Err(error) = mavlink_bindgen::generate(xml, &out) {
            println!("cargo::error={path}: {error}");
        }
    }
}
