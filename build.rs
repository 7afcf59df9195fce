//! Generates the pair dialect's Rust code from `message_definitions/veilwing.xml`.

fn main() {
    println!("cargo:rerun-if-changed=message_definitions/veilwing.xml");
    #[cfg(feature = "companion")]
    generate();
}

#[cfg(feature = "companion")]
fn generate() {
    // The generated mod.rs hides each dialect behind a feature of its name; ours is always wanted.
    println!("cargo:rustc-cfg=feature=\"dialect-veilwing\"");
    let out = std::env::var_os("OUT_DIR").unwrap_or_default();
    let xml = mavlink_bindgen::XmlDefinitions::Files(vec!["message_definitions/veilwing.xml"]);
    if let Err(error) = mavlink_bindgen::generate(xml, out) {
        println!("cargo::error=message_definitions/veilwing.xml: {error}");
    }
}
