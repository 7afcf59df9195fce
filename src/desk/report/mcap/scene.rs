//! What a flight's three-dimensional view shows beside the vehicles' frames.

use nalgebra::{UnitQuaternion, Vector3};

use super::messages::{MISSION, Moment, colour_of, frame, pose, vector};
use super::protobuf::Message;
use crate::desk::report::timeline::{Listener, Timeline};
use crate::role::Role;

const I: [f64; 3] = [0.0, 0.45, 0.7];
const J: [f64; 3] = [0.83, 0.37, 0.0];
const USER: [f64; 3] = [0.0, 0.62, 0.45];
const EAVESDROPPER: [f64; 3] = [0.8, 0.25, 0.6];
const AREA: [f64; 3] = [0.5, 0.5, 0.5];
const NO_FLY: [f64; 3] = [0.75, 0.1, 0.1];
/// A node's ball.
const BALL_M: f64 = 2.0;
/// Of lines, in pixels.
const THICK: f64 = 2.0;
/// Half the drawn length of an axis, and the length of a null's cone.
const NULL_M: f64 = 60.0;
/// The cone's edge: a hundredth of the gain, as in the report's maps.
const NULL_GAIN: f64 = 0.01;

fn straight(position: &Vector3<f64>) -> Message {
    pose(position, &UnitQuaternion::identity())
}

/// An entity that stays until the end.
fn entity(moment: Moment, frame: &str, id: &str) -> Message {
    let follows = frame != MISSION;
    Message::default()
        .message(1, &moment.message())
        .text(2, frame)
        .text(3, id)
        .message(4, &Message::default().integer(1, 0).integer(2, 0))
        .flag(5, follows)
}

fn line(closed: bool, points: &[[f64; 3]], colour: [f64; 3]) -> Message {
    Message::default()
        .integer(1, closed.into())
        .message(2, &straight(&Vector3::zeros()))
        .double(3, THICK)
        .flag(4, true)
        .messages(5, points.iter().map(|point| vector(&Vector3::from(*point))))
        .message(6, &colour_of(colour, 1.0))
}

fn ball(at: &Vector3<f64>, colour: [f64; 3]) -> Message {
    Message::default()
        .message(1, &straight(at))
        .message(2, &vector(&Vector3::repeat(BALL_M)))
        .message(3, &colour_of(colour, 1.0))
}

fn lettering(at: &Vector3<f64>, colour: [f64; 3], text: &str) -> Message {
    Message::default()
        .message(1, &straight(&(at + Vector3::z() * (1.5 * BALL_M))))
        .flag(2, true)
        .double(3, 14.0)
        .flag(4, true)
        .message(5, &colour_of(colour, 1.0))
        .text(6, text)
}

/// The edges of a prism.
fn prism(corners: &[[f64; 2]], [low, high]: [f64; 2], colour: [f64; 3]) -> Vec<Message> {
    let ring = |up: f64| corners.iter().map(|[e, n]| [*e, *n, up]).collect::<Vec<_>>();
    let mut lines = vec![line(true, &ring(low), colour), line(true, &ring(high), colour)];
    lines.extend(corners.iter().map(|[e, n]| line(false, &[[*e, *n, low], [*e, *n, high]], colour)));
    lines
}

/// A horizontal circle.
fn circle(middle: &[f64; 3], radius_m: f64, colour: [f64; 3]) -> Message {
    let points: Vec<[f64; 3]> = (0..48)
        .map(|k| {
            let (s, c) = (std::f64::consts::TAU * f64::from(k) / 48.0).sin_cos();
            [middle[0] + radius_m * c, middle[1] + radius_m * s, middle[2]]
        })
        .collect();
    line(true, &points, colour)
}

/// A cone of the null, from the vehicle along its antenna's axis, upwards or downwards.
fn cone(up: bool, colour: [f64; 3]) -> Message {
    let along = if up { NULL_M / 2.0 } else { -NULL_M / 2.0 };
    let wide = 2.0 * NULL_M * NULL_GAIN.sqrt().asin().tan();
    let (bottom, top) = if up { (0.0, 1.0) } else { (1.0, 0.0) };
    Message::default()
        .message(1, &straight(&Vector3::new(0.0, 0.0, along)))
        .message(2, &vector(&Vector3::new(wide, wide, NULL_M)))
        .double(3, bottom)
        .double(4, top)
        .message(5, &colour_of(colour, 0.15))
}

/// A vehicle's axis and the cones of its null, in its own frame.
fn antenna(moment: Moment, role: Role) -> Message {
    let (colour, name) = match role {
        Role::I => (I, "I"),
        Role::J => (J, "J"),
    };
    let ends = [[0.0, 0.0, -NULL_M], [0.0, 0.0, NULL_M]];
    entity(moment, frame(role), &format!("antenna/{}", role.key()))
        .messages(9, [ball(&Vector3::zeros(), colour)])
        .messages(10, [cone(true, colour), cone(false, colour)])
        .messages(11, [line(false, &ends, colour)])
        .messages(13, [lettering(&Vector3::zeros(), colour, name)])
}

fn eavesdropper(moment: Moment, listener: &Listener) -> Message {
    let mut circles: Vec<Message> = Vec::new();
    let of_std = listener.std_m.map(|std_m| [std_m, 2.0 * std_m]);
    for radius_m in listener.radius_m.into_iter().chain(of_std.into_iter().flatten()) {
        circles.push(circle(&listener.position_enu_m, radius_m, EAVESDROPPER));
    }
    let at = Vector3::from(listener.position_enu_m);
    let mut balls = vec![ball(&at, EAVESDROPPER)];
    let mut texts = vec![lettering(&at, EAVESDROPPER, &listener.name)];
    if let Some(truth) = listener.true_position_enu_m.filter(|truth| *truth != listener.position_enu_m) {
        circles.push(line(false, &[listener.position_enu_m, truth], EAVESDROPPER));
        balls.push(ball(&truth.into(), EAVESDROPPER));
        texts.push(lettering(&truth.into(), EAVESDROPPER, &format!("{}, in truth", listener.name)));
    }
    entity(moment, MISSION, &format!("eavesdropper/{}", listener.name))
        .messages(9, balls)
        .messages(11, circles)
        .messages(13, texts)
}

/// All of it.
pub(super) fn update(timeline: &Timeline, moment: Moment) -> Message {
    let scene = &timeline.scene;
    let mut entities = Vec::new();
    if let Some(air) = &scene.airspace {
        let lines = prism(&air.area_enu_m, air.altitude_m, AREA);
        entities.push(entity(moment, MISSION, "area").messages(11, lines));
        for area in &air.no_fly {
            let floor = area.floor_m.unwrap_or(0.0);
            let lines = prism(&area.corners_m, [floor, area.ceiling_m.unwrap_or(air.altitude_m[1])], NO_FLY);
            let name = area.corners_m.first().map(|[e, n]| {
                lettering(&Vector3::new(*e, *n, floor), NO_FLY, &format!("no-fly: {}", area.name))
            });
            let id = format!("no-fly/{}", area.name);
            entities.push(entity(moment, MISSION, &id).messages(11, lines).messages(13, name));
        }
    }
    for user in &scene.users {
        let at = Vector3::from(user.position_enu_m);
        let user = entity(moment, MISSION, &format!("user/{}", user.name))
            .messages(9, [ball(&at, USER)])
            .messages(13, [lettering(&at, USER, &user.name)]);
        entities.push(user);
    }
    entities.extend(scene.eavesdroppers.iter().map(|listener| eavesdropper(moment, listener)));
    entities.extend(Role::BOTH.map(|role| antenna(moment, role)));
    Message::default().messages(2, entities)
}
