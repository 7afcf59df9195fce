//! Work on an indexed list by several threads, the result independent of their number.

/// `work(memory, index)` for every index below `count`, in order of index. Each thread has a memory of its own; `work`
/// must not let a result depend on what a memory held before.
pub fn map<M: Default, R: Send>(
    threads: usize,
    count: usize,
    work: impl Fn(&mut M, usize) -> R + Sync,
) -> Vec<R> {
    let threads = threads.clamp(1, count.max(1));
    if threads == 1 {
        let mut memory = M::default();
        return (0..count).map(|index| work(&mut memory, index)).collect();
    }
    let mut slots: Vec<Option<R>> = (0..count).map(|_| None).collect();
    let mut lanes: Vec<Vec<(usize, &mut Option<R>)>> = (0..threads).map(|_| Vec::new()).collect();
    for (index, slot) in slots.iter_mut().enumerate() {
        lanes[index % threads].push((index, slot));
    }
    std::thread::scope(|scope| {
        for lane in lanes {
            let work = &work;
            scope.spawn(move || {
                let mut memory = M::default();
                for (index, slot) in lane {
                    *slot = Some(work(&mut memory, index));
                }
            });
        }
    });
    // The scope has joined every thread: no slot is empty.
    slots.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn spec_order_is_that_of_indices() {
        for threads in [1, 2, 3, 50] {
            let squares = super::map(threads, 20, |_: &mut (), k| k * k);
            assert_eq!(squares, (0..20).map(|k| k * k).collect::<Vec<_>>());
        }
        assert!(super::map(4, 0, |_: &mut (), k| k).is_empty());
    }
}
