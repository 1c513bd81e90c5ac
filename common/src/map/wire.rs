//! What stands in the body of a map file, section by section: integers on the
//! grid, as steps from what came before. Nothing here knows metres, and
//! nothing here is checked beyond being readable; `FORMAT.md` says what it
//! means.

use bincode::de::Decoder;
use bincode::enc::Encoder;
use bincode::error::{DecodeError, EncodeError};
use bincode::{Decode, Encode};

use super::envelope::Form;
use super::varint::{Signed, Unsigned};
use super::{LaneKind, PoleKind, SectionSize, SignKind};
use crate::{Error, Result};

/// Most memory that one section may ask for, bytes. Nothing is allocated
/// ahead of the bytes that fill it, so this only ends absurd counts early.
pub(super) const DECODE_LIMIT: usize = 1 << 28;

/// A list: its length, then its items.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct List<T>(pub Vec<T>);

/// Landmarks of one kind: for every road up to the last that has some, those
/// on that road.
pub(super) type ByRoad<T> = List<List<T>>;

/// A step between two points on the grid: x, y, z.
pub(super) type Step = [Signed; 3];

/// What the body begins with.
#[derive(Debug, Clone, PartialEq, Eq, Encode, Decode)]
pub(super) struct Head {
    /// Grid step, micrometres.
    pub quantum_um: Unsigned,
    /// The frame note in UTF-8.
    pub frame_note: List<u8>,
    /// Smallest coordinates of anything in the map; 0 for an empty one.
    pub min: Step,
    /// How far it extends from there.
    pub extent: [Unsigned; 3],
}

/// A point sequence. The first step leads to the first vertex; the others are
/// steps between vertices, or the changes of these steps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Polyline {
    /// From the third vertex on, the change of the step stands for the step.
    pub second_order: bool,
    /// One per vertex.
    pub steps: Vec<Step>,
}

/// A pole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Encode, Decode)]
pub(super) struct Pole {
    /// To the foot, from the foot before it on the same road.
    pub foot: Step,
    /// How far the top is above the foot (towards -y).
    pub height: Unsigned,
    /// How far the top is aside of the foot along x and z, in thousandths of the
    /// height, or in quanta in older versions.
    pub lean: [Signed; 2],
}

/// A sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Encode, Decode)]
pub(super) struct Sign {
    /// To the centroid, from the centroid before it on the same road.
    pub centroid: Step,
    /// Its size.
    pub size: Unsigned,
}

/// The marks of a dashed line: the change of the gap before each, and of its
/// length, from those of the mark before.
pub(super) type Marks = List<[Signed; 2]>;

/// The whole body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Body {
    pub head: Head,
    pub roads: List<Polyline>,
    pub poles: [ByRoad<Pole>; PoleKind::ALL.len()],
    pub signs: [ByRoad<Sign>; SignKind::ALL.len()],
    pub lanes: [ByRoad<Polyline>; LaneKind::PAINTED.len()],
    /// Of the dashed lines, up to the last that has some; none in a file that
    /// has no such section.
    pub marks: Option<List<Marks>>,
    /// None in a file that has no such section.
    pub kerbs: Option<ByRoad<Polyline>>,
}

impl Body {
    /// The bytes of all sections.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        append(&mut bytes, &self.head)?;
        append(&mut bytes, &self.roads)?;
        self.poles.iter().try_for_each(|poles| append(&mut bytes, poles))?;
        self.signs.iter().try_for_each(|signs| append(&mut bytes, signs))?;
        self.lanes.iter().try_for_each(|lanes| append(&mut bytes, lanes))?;
        self.marks.iter().try_for_each(|marks| append(&mut bytes, marks))?;
        self.kerbs.iter().try_for_each(|kerbs| append(&mut bytes, kerbs))?;
        Ok(bytes)
    }

    /// All sections, the last two only where its form has them, and how much each took.
    pub fn from_bytes(bytes: &[u8], form: Form) -> Result<(Self, Vec<SectionSize>)> {
        let mut reader = SectionReader { rest: bytes, sizes: Vec::new() };
        let head = reader.section("header", |_| 1)?;
        let roads = reader.section("roads", |roads: &List<_>| roads.0.len())?;
        let mut poles = PoleKind::ALL.map(|_| List(Vec::new()));
        for (slot, kind) in poles.iter_mut().zip(PoleKind::ALL) {
            *slot = reader.section(kind.name(), count)?;
        }
        let mut signs = SignKind::ALL.map(|_| List(Vec::new()));
        for (slot, kind) in signs.iter_mut().zip(SignKind::ALL) {
            *slot = reader.section(kind.name(), count)?;
        }
        let mut lanes = LaneKind::PAINTED.map(|_| List(Vec::new()));
        for (slot, kind) in lanes.iter_mut().zip(LaneKind::PAINTED) {
            *slot = reader.section(kind.name(), count)?;
        }
        let of_all = |marks: &List<Marks>| marks.0.iter().map(|line| line.0.len()).sum();
        let marks = if form.has_marks { Some(reader.section("marks", of_all)?) } else { None };
        let kerbs = if form.has_kerbs { Some(reader.section(LaneKind::Kerb.name(), count)?) } else { None };
        if !reader.rest.is_empty() {
            let what = format!("{} bytes stand after the last section", reader.rest.len());
            return Err(Error::MapMalformed { what });
        }
        Ok((Self { head, roads, poles, signs, lanes, marks, kerbs }, reader.sizes))
    }
}

fn count<T>(groups: &ByRoad<T>) -> usize {
    groups.0.iter().map(|group| group.0.len()).sum()
}

fn append(bytes: &mut Vec<u8>, section: &impl Encode) -> Result<()> {
    bincode::encode_into_std_write(section, bytes, bincode::config::standard())
        .map(|_| ())
        .map_err(|e| Error::MapUnencodable { what: e.to_string() })
}

/// Takes one section after the other off the front of the body.
struct SectionReader<'a> {
    rest: &'a [u8],
    sizes: Vec<SectionSize>,
}

impl SectionReader<'_> {
    fn section<T: Decode<()>>(&mut self, name: &str, count: impl Fn(&T) -> usize) -> Result<T> {
        let config = bincode::config::standard().with_limit::<DECODE_LIMIT>();
        let (section, bytes) = bincode::decode_from_slice(self.rest, config).map_err(|e| {
            let why = match e {
                DecodeError::Other(why) => why.to_owned(),
                DecodeError::UnexpectedEnd { .. } => "the bytes end inside it".to_owned(),
                DecodeError::LimitExceeded => "it announces more items than any map has".to_owned(),
                other => other.to_string(),
            };
            Error::MapMalformed { what: format!("section `{name}`: {why}") }
        })?;
        self.rest = &self.rest[bytes..];
        self.sizes.push(SectionSize { name: name.to_owned(), items: count(&section), bytes });
        Ok(section)
    }
}

impl<T: Encode> Encode for List<T> {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> std::result::Result<(), EncodeError> {
        Unsigned(self.0.len() as u64).encode(encoder)?;
        self.0.iter().try_for_each(|item| item.encode(encoder))
    }
}

impl<Context, T: Decode<Context>> Decode<Context> for List<T> {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> std::result::Result<Self, DecodeError> {
        let Unsigned(length) = Unsigned::decode(decoder)?;
        items(decoder, length).map(Self)
    }
}

impl Encode for Polyline {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> std::result::Result<(), EncodeError> {
        Unsigned((self.steps.len() as u64) << 1 | u64::from(self.second_order)).encode(encoder)?;
        self.steps.iter().try_for_each(|step| step.encode(encoder))
    }
}

impl<Context> Decode<Context> for Polyline {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> std::result::Result<Self, DecodeError> {
        let Unsigned(head) = Unsigned::decode(decoder)?;
        Ok(Self { second_order: head & 1 == 1, steps: items(decoder, head >> 1)? })
    }
}

/// So many items. The memory follows the bytes that are really there: an
/// item is only made room for once the one before it has been read.
fn items<Context, T: Decode<Context>, D: Decoder<Context = Context>>(
    decoder: &mut D,
    length: u64,
) -> std::result::Result<Vec<T>, DecodeError> {
    let length = usize::try_from(length).map_err(|_| DecodeError::LimitExceeded)?;
    decoder.claim_container_read::<T>(length)?;
    let mut items = Vec::new();
    for _ in 0..length {
        decoder.unclaim_bytes_read(size_of::<T>());
        items.push(T::decode(decoder)?);
    }
    Ok(items)
}

bincode::impl_borrow_decode!(Polyline);

impl<'de, Context, T: Decode<Context>> bincode::BorrowDecode<'de, Context> for List<T> {
    fn borrow_decode<D: bincode::de::BorrowDecoder<'de, Context = Context>>(
        decoder: &mut D,
    ) -> std::result::Result<Self, DecodeError> {
        Self::decode(decoder)
    }
}
