//! The task that drives a device.

use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender};

use super::Device;
use crate::radio_host::{Order, OrderId, Outcome};

/// Has `device` carry out the orders, the newest alone: one that is under way when the next one comes is dropped. Ends when
/// nobody gives orders any more, or takes outcomes.
pub async fn drive(
    mut device: impl Device,
    mut orders: UnboundedReceiver<(OrderId, Order)>,
    outcomes: UnboundedSender<(OrderId, Outcome)>,
) {
    let mut next = orders.recv().await;
    while let Some((id, order)) = next.take() {
        let outcome = tokio::select! {
            biased;
            newer = orders.recv() => {
                next = newer;
                continue;
            }
            outcome = carry_out(&mut device, order) => outcome,
        };
        if outcomes.send((id, outcome)).is_err() {
            return;
        }
        next = orders.recv().await;
    }
}

async fn carry_out(device: &mut impl Device, order: Order) -> Outcome {
    let done = match order {
        Order::Off => device.off().await.map(|()| Outcome::Off),
        Order::Set(setting) => device.set(setting.value).await.map(|read_back| Outcome::Set { read_back }),
    };
    done.unwrap_or_else(|error| {
        let told = if order == Order::Off { "off" } else { "on" };
        tracing::warn!(told, %error, "the device did not do it");
        Outcome::Failed(error.fault())
    })
}
