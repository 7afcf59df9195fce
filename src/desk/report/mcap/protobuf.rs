//! Protocol Buffers: messages, and the descriptors by which a reader that knows nothing of us takes them apart.
//!
//! Own, because a generator needs `protoc` at build time, and because what is written is a dozen flat messages.

/// A message's fields so far, as they go on the wire.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Message(Vec<u8>);

impl Message {
    const VARINT: u64 = 0;
    const EIGHT_BYTES: u64 = 1;
    const LENGTH: u64 = 2;
    const FOUR_BYTES: u64 = 5;

    fn tag(&mut self, number: u32, wire: u64) {
        self.varint(u64::from(number) << 3 | wire);
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    /// A `double`.
    pub fn double(mut self, number: u32, value: f64) -> Self {
        self.tag(number, Self::EIGHT_BYTES);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// A `fixed32`.
    pub fn fixed32(mut self, number: u32, value: u32) -> Self {
        self.tag(number, Self::FOUR_BYTES);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// An `int64`, an `int32` or an enumeration; negative ones take ten bytes in all three.
    pub fn integer(mut self, number: u32, value: i64) -> Self {
        self.tag(number, Self::VARINT);
        self.varint(value.cast_unsigned());
        self
    }

    /// A `bool`.
    pub fn flag(self, number: u32, value: bool) -> Self {
        self.integer(number, value.into())
    }

    /// A `string`.
    pub fn text(self, number: u32, value: &str) -> Self {
        self.bytes(number, value.as_bytes())
    }

    /// A message inside this one.
    pub fn message(self, number: u32, value: &Self) -> Self {
        self.bytes(number, &value.0)
    }

    /// A repeated `double`.
    pub fn doubles(self, number: u32, values: &[f64]) -> Self {
        let packed: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.bytes(number, &packed)
    }

    /// A repeated message.
    pub fn messages(self, number: u32, values: impl IntoIterator<Item = Self>) -> Self {
        values.into_iter().fold(self, |message, value| message.message(number, &value))
    }

    fn bytes(mut self, number: u32, value: &[u8]) -> Self {
        self.tag(number, Self::LENGTH);
        self.varint(value.len() as u64);
        self.0.extend(value);
        self
    }

    /// What goes into the file.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// What a field is.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Double,
    Int64,
    Int32,
    Fixed32,
    Bool,
    Text,
    Bytes,
    /// One of the type's own enumerations, by name.
    Enum(&'static str),
    Of(&'static Type),
    /// Any number of them.
    Many(&'static Type),
    ManyDoubles,
    ManyFixed32,
}

/// A field: number, name, and what it is.
pub(super) type Field = (u32, &'static str, Kind);

/// An enumeration: its name, and its values from 0 on.
pub(super) type Enumeration = (&'static str, &'static [&'static str]);

/// A type of messages.
#[derive(Debug)]
pub(super) struct Type {
    /// With its package.
    pub name: &'static str,
    pub fields: &'static [Field],
    pub enums: &'static [Enumeration],
}

impl Type {
    fn package_and_name(&self) -> (&'static str, &'static str) {
        self.name.rsplit_once('.').unwrap_or(("", self.name))
    }

    /// The file that is said to define it: one a type.
    fn file(&self) -> String {
        let (package, name) = self.package_and_name();
        // By these names everybody knows Google's own.
        let name = if package == "google.protobuf" { name.to_lowercase() } else { name.to_owned() };
        format!("{}/{name}.proto", package.replace('.', "/"))
    }

    fn uses(&self) -> impl Iterator<Item = &'static Self> {
        self.fields.iter().filter_map(|(_, _, kind)| match kind {
            Kind::Of(other) | Kind::Many(other) => Some(*other),
            _ => None,
        })
    }

    /// A `FileDescriptorSet` of this type and all that it is made of, each before what uses it.
    pub fn descriptors(&'static self) -> Vec<u8> {
        let mut all = Vec::new();
        self.collect(&mut all);
        Message::default().messages(1, all.into_iter().map(Self::descriptor)).finish()
    }

    fn collect(&'static self, all: &mut Vec<&'static Self>) {
        if all.iter().any(|known| known.name == self.name) {
            return;
        }
        self.uses().for_each(|other| other.collect(all));
        all.push(self);
    }

    /// A `FileDescriptorProto`.
    fn descriptor(&'static self) -> Message {
        let (package, name) = self.package_and_name();
        let mut used: Vec<String> = self.uses().map(Self::file).collect();
        used.sort();
        used.dedup();
        let mut file = Message::default().text(1, &self.file()).text(2, package);
        for other in &used {
            file = file.text(3, other);
        }
        let enums = self.enums.iter().map(|(name, values)| {
            let values = values.iter().zip(0..).map(|(v, k)| Message::default().text(1, v).integer(2, k));
            Message::default().text(1, name).messages(2, values)
        });
        let fields = self.fields.iter().map(|field| self.field(field));
        let message = Message::default().text(1, name).messages(2, fields).messages(4, enums);
        file.message(4, &message).text(12, "proto3")
    }

    /// A `FieldDescriptorProto`.
    fn field(&self, (number, name, kind): &Field) -> Message {
        let (kind, of, repeated) = match kind {
            Kind::Double => (1, None, false),
            Kind::ManyDoubles => (1, None, true),
            Kind::Int64 => (3, None, false),
            Kind::Int32 => (5, None, false),
            Kind::Fixed32 => (7, None, false),
            Kind::ManyFixed32 => (7, None, true),
            Kind::Bool => (8, None, false),
            Kind::Text => (9, None, false),
            Kind::Of(other) => (11, Some(format!(".{}", other.name)), false),
            Kind::Many(other) => (11, Some(format!(".{}", other.name)), true),
            Kind::Bytes => (12, None, false),
            Kind::Enum(own) => (14, Some(format!(".{}.{own}", self.name)), false),
        };
        let field = Message::default()
            .text(1, name)
            .integer(3, (*number).into())
            .integer(4, if repeated { 3 } else { 1 })
            .integer(5, kind);
        of.map_or(field.clone(), |of| field.text(6, &of))
    }
}
