//! A link speaks whatever dialect it is given, so also the pair's own.

use mavlink::Message;
use veilwing::link::{Clock, Link, LinkConfig, MemoryEnd, TlogReader, TlogWriter};
use veilwing::pair::wire::MavMessage;

use crate::tlog::directory;

/// `tests/stranger/read_tlog.py --definitions message_definitions/veilwing.xml` reads the log that this leaves.
#[tokio::test]
async fn prop_the_pairs_own_dialect_goes_over_a_link_and_into_a_log() {
    let path = directory("tlog-pair").join("pair.tlog");
    let (a, b) = MemoryEnd::pair();
    let tlog = Some(TlogWriter::create(&path).unwrap());
    let mut a = Link::in_memory(a, LinkConfig { tlog, ..LinkConfig::default() }, Clock::real()).unwrap();
    let mut b = Link::in_memory(b, LinkConfig::default(), Clock::real()).unwrap();
    for &id in MavMessage::all_ids() {
        let message = MavMessage::default_message_from_id(id).unwrap();
        a.send((1, 191), &message);
        assert_eq!(b.recv().await.message, message);
        b.send((2, 191), &message);
        assert_eq!(a.recv().await.message, message);
    }
    drop(a);
    let ids: Vec<_> = TlogReader::open(&path).unwrap().map(|record| record.unwrap().1.message_id()).collect();
    let expected: Vec<_> = MavMessage::all_ids().iter().flat_map(|&id| [id, id]).collect();
    assert_eq!(ids, expected);
}
