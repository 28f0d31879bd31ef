//! An agent without a library: searches the reported places by the urgency of each, reports what it sees there, comes home.
mod rebar_air;
use rebar_air::{apart, Bench, Eye, Json, Seen};

// A sighting in three detections of one class within 15 m, none of them doubtful; who walks is elsewhere after 30 s. Chosen.
const SIGHTINGS: u32 = 3;
const NEAR_M: f64 = 15.0;
const SCORE: f64 = 0.35;
const FORGET_S: f64 = 30.0;

type Things = Vec<(Seen, f64)>; // with the time at which each was last seen

fn walks(thing: &Seen, mission: &Json) -> bool {
    mission.list("bystander_classes").iter().any(|label| label.as_text() == thing.class_label)
}

fn remember(things: &mut Things, seen: Seen, now_s: f64) {
    let is_same = |thing: &&mut (Seen, f64)| thing.0.class_label == seen.class_label && apart(thing.0.place, seen.place) < NEAR_M;
    let Some((same, seen_s)) = things.iter_mut().find(is_same) else { return things.push((seen, now_s)) };
    (same.frames, *seen_s) = (same.frames + 1, now_s); // and the mean of all sightings
    for (mean, value) in same.place.iter_mut().zip(seen.place) {
        *mean += (value - *mean) / same.frames as f64;
    }
    same.confidence = same.confidence.max(seen.confidence);
}

/// Whether the target was seen, and has been reported.
fn report(bench: &mut Bench, mission: &Json, things: &Things, target: &Json) -> bool {
    let sure = || things.iter().map(|thing| &thing.0).filter(|thing| thing.frames >= SIGHTINGS);
    let is_there = |thing: &&Seen| apart(thing.place, target.place()) <= target.number("uncertainty_m");
    let Some(found) = sure().filter(is_there).find(|thing| thing.class_label == target.text("class_label")) else { return false };
    let is_beside = |thing: &&Seen| walks(thing, mission) && apart(thing.place, found.place) < mission.number("no_mark_within_m");
    let (people, id, [east_m, north_m]) = (sure().filter(is_beside).count(), target.text("id"), found.place);
    let named = format!("\"id\":\"report-{id}\",\"intelligence_id\":\"{id}\",\"class_label\":\"{}\"", found.class_label);
    let placed = format!("\"east_m\":{east_m},\"north_m\":{north_m},\"confidence\":{}", found.confidence);
    let marked = format!("\"mark\":{},\"bystanders_seen\":{people},\"reason\":\"{people} people are near\"", people == 0);
    bench.publish("reports", format!("{named},{placed},{marked}"));
    true
}

fn tell(bench: &mut Bench, mission: &Json, things: &Things, phase: &str) {
    let mut tracks = Vec::new();
    for (number, (thing, seen_s)) in things.iter().enumerate() {
        let Seen { class_label, confidence, place: [east_m, north_m], frames } = thing;
        if *frames >= SIGHTINGS && (bench.now_s - seen_s < FORGET_S || !walks(thing, mission)) {
            let named = format!("\"id\":\"{class_label}-{number}\",\"class_label\":\"{class_label}\",\"frames\":{frames}");
            tracks.push(format!("{{{named},\"east_m\":{east_m},\"north_m\":{north_m},\"confidence\":{confidence}}}"));
        }
    }
    bench.vehicle.heartbeat();
    bench.publish("status", format!("\"phase\":\"{phase}\""));
    bench.publish("tracks", format!("\"tracks\":[{}]", tracks.join(",")));
}

/// The next phase. `left` are the places that are not visited, the most urgent first.
fn fly(bench: &mut Bench, mission: &Json, phase: &'static str, again: bool, left: &mut Vec<Json>, arrived_s: &mut Option<f64>) -> &'static str {
    let (vehicle, height_m) = (&mut bench.vehicle, mission.number("altitude_m"));
    match (phase, vehicle.is_armed) {
        ("starting" | "taking_off", is_armed) => {
            if again && vehicle.is_ready {
                if is_armed { vehicle.take_off(height_m) } else { vehicle.arm() }
            }
            return if vehicle.height_m > 0.8 * height_m { "transit" } else if is_armed { "taking_off" } else { "starting" };
        }
        ("landing", true) if again => vehicle.land(),
        ("landing", false) => return "complete",
        ("landing" | "complete", _) => (),
        _ => {
            let goal = left.first().unwrap_or(mission.get("home")).place();
            if again {
                vehicle.go_to(goal, height_m, mission.number("speed_mps"));
            }
            if apart(vehicle.place(), goal) < 5.0 {
                // Over the place for eight seconds, or down at home.
                if left.is_empty() {
                    return "landing";
                } else if bench.now_s - *arrived_s.get_or_insert(bench.now_s) > 8.0 {
                    (*arrived_s, _) = (None, left.remove(0));
                }
            }
            return if left.is_empty() { "returning" } else { "transit" };
        }
    }
    phase
}

fn main() {
    let topics = ["mission", "intelligence", "orders", "detections", "/tf", "/tf_static", "camera/front/camera_info"];
    let (mut eye, mut things, mut mission, mut phase) = (Eye::default(), Things::new(), Json::Null, "starting");
    let (mut left, mut unreported, mut arrived_s, mut asked_s, mut second_s) = (Vec::new(), Vec::new(), None, -10.0, -10.0);
    let mut bench = Bench::open("tick-search", &topics);
    while let Some(messages) = bench.tick() {
        let (now_s, again) = (bench.now_s, bench.now_s - asked_s >= 3.0);
        for (topic, message) in messages {
            if topic.ends_with("/mission") {
                mission = message;
            } else if topic.ends_with("/intelligence") {
                left.push(message.clone());
                left.sort_by(|a: &Json, b: &Json| a.number("priority").total_cmp(&b.number("priority")));
                unreported.push(message);
            } else if topic.ends_with("/orders") {
                let refused = "\"accepted\":false,\"reason\":\"this agent knows no orders yet\"";
                bench.publish("answers", format!("\"order\":\"{}\",{refused}", message.text("id")));
            } else {
                let is_clear = |seen: &Seen| seen.confidence >= SCORE;
                eye.see(&topic, &message).into_iter().filter(is_clear).for_each(|seen| remember(&mut things, seen, now_s));
            }
        }
        if now_s - second_s >= 1.0 {
            second_s = now_s;
            tell(&mut bench, &mission, &things, phase);
        }
        if !matches!(mission, Json::Null) {
            unreported.retain(|target| !report(&mut bench, &mission, &things, target));
            phase = fly(&mut bench, &mission, phase, again, &mut left, &mut arrived_s);
        }
        asked_s = if again { now_s } else { asked_s };
        bench.ack();
    }
}
