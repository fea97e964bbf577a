//! `examples/skysink.hpp`: the messages of the ring in C++, generated from their types.

use std::collections::HashMap;
use std::fs;

use cbindgen::{Builder, Config, DocumentationStyle, ItemType, Language};
use iceoryx2::prelude::ZeroCopySend;
use skysink_common::message::{
    Commit, FlightReport, HeardLink, Limits, LinkReport, NodeAnswer, PathPoint, Plan, QueuesHeader, SensorNode,
    SensorsHeader, SlotHeader, Tick, Totals,
};
use skysink_ring::health::{Health, Ready};

use super::ROOT;

/// Where the types are defined; what a constant is made of comes first.
const SOURCES: [&str; 5] = [
    "common/src/channel/mod.rs",
    "common/src/nodes/ledger.rs",
    "common/src/scenario/limits.rs",
    "common/src/messages/message.rs",
    "ring/src/health.rs",
];

const TITLE: &str = "\
// The messages of Skysink's ring (docs/src/interfaces.md), generated from common/src/messages/message.rs by
// cargo test --workspace --test it write_the_layouts -- --ignored";

/// A message: its name in C++, its iceoryx2 type name and its length.
fn message<T: ZeroCopySend>() -> (String, &'static str, usize) {
    // SAFETY: the name is only written down; the same layout is what the length is checked for.
    let type_name = unsafe { <T as ZeroCopySend>::type_name() };
    let name = type_name.split('.').nth(1).expect("skysink.NAME.VERSION");
    (name.to_owned(), type_name, size_of::<T>())
}

/// The header that the types generate.
pub fn generated() -> String {
    let messages = [
        message::<SlotHeader>(),
        message::<SensorsHeader>(),
        message::<Limits>(),
        message::<SensorNode>(),
        message::<NodeAnswer>(),
        message::<QueuesHeader>(),
        message::<Totals>(),
        message::<Plan>(),
        message::<HeardLink>(),
        message::<PathPoint>(),
        message::<FlightReport>(),
        message::<LinkReport>(),
        message::<Tick>(),
        message::<Commit>(),
        message::<Ready>(),
        message::<Health>(),
    ];
    let mut config = Config {
        language: Language::Cxx,
        header: Some(TITLE.to_owned()),
        pragma_once: true,
        namespace: Some("skysink".to_owned()),
        documentation_style: DocumentationStyle::Cxx,
        usize_is_size_t: true,
        no_includes: true,
        sys_includes: ["cstddef", "cstdint"].map(str::to_owned).to_vec(),
        line_length: 120,
        tab_width: 4,
        ..Config::default()
    };
    config.export.item_types = vec![ItemType::Constants, ItemType::Enums, ItemType::Structs];
    config.export.include = ["Mode", "SolverOutcome", "HoldReason"].map(str::to_owned).to_vec();
    config.export.include.extend(messages.iter().map(|(name, ..)| name.clone()));
    config.export.exclude =
        ["LETTER", "MAX_SEED", "MAX_SENSORS", "HEARD_SNRS", "BYTES_PER_HEARD"].map(str::to_owned).to_vec();
    let constant = |type_name| format!("    static constexpr const char* IOX2_TYPE_NAME = \"{type_name}\";\n");
    config.export.pre_body =
        messages.iter().map(|(name, type_name, _)| (name.clone(), constant(type_name))).collect::<HashMap<_, _>>();
    let check = |(name, _, length): &(String, _, usize)| {
        format!("static_assert(sizeof(skysink::{name}) == {length}, \"the layout of docs/src/interfaces.md\");\n")
    };
    config.trailer = Some(messages.iter().map(check).collect());
    let builder = SOURCES.iter().fold(Builder::new(), |builder, source| builder.with_src(format!("{ROOT}/{source}")));
    let mut text = Vec::new();
    builder.with_config(config).generate().expect("the types are plain").write(&mut text);
    String::from_utf8(text).expect("text")
}

fn path() -> String {
    format!("{ROOT}/examples/skysink.hpp")
}

/// Writes the header anew.
pub fn refresh() {
    fs::write(path(), generated()).expect("the header can be written");
}

/// Fails if the header is not what the types generate.
pub fn is_what_the_types_generate() {
    let committed = fs::read_to_string(path()).unwrap();
    let remedy = "`cargo test --workspace --test it write_the_layouts -- --ignored` writes it anew";
    assert!(committed == generated(), "examples/skysink.hpp is not what the types generate: {remedy}");
}
