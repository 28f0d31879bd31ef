//! A client of the bench in one file, with nothing but Rust's std: put it beside your agent (manifest: `air: tick`).
//!
//! The air network comes and goes as JSON in the lines of the tick socket; MAVLink goes over UDP and is read and written here
//! as far as an agent needs it that flies by the autopilot's own modes. docs/agents-protocol.md describes both.
#![allow(dead_code)]

use std::collections::HashMap;
use std::env;
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};

const OWN: [u8; 2] = [246, 1];
const ARDUPILOT: u8 = 3;
const EARTH_M: f64 = 6378137.0;

#[derive(Clone, Debug)]
pub enum Json {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Json>),
    Object(Vec<(String, Json)>),
}

/// What `get` gives where there is nothing.
static NOTHING: Json = Json::Null;

impl Json {
    pub fn read(text: &str) -> Json {
        Reader { text: text.as_bytes(), at: 0 }.value()
    }

    pub fn get(&self, key: &str) -> &Json {
        match self {
            Json::Object(fields) => fields.iter().find(|field| field.0 == key).map_or(&NOTHING, |field| &field.1),
            _ => &NOTHING,
        }
    }

    pub fn number(&self, key: &str) -> f64 {
        if let Json::Number(number) = self.get(key) { *number } else { 0.0 }
    }

    pub fn text(&self, key: &str) -> &str {
        self.get(key).as_text()
    }

    pub fn as_text(&self) -> &str {
        if let Json::Text(text) = self { text } else { "" }
    }

    pub fn list(&self, key: &str) -> &[Json] {
        if let Json::List(items) = self.get(key) { items } else { &[] }
    }

    /// `east_m` and `north_m`.
    pub fn place(&self) -> [f64; 2] {
        [self.number("east_m"), self.number("north_m")]
    }
}

struct Reader<'a> {
    text: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    /// The next character that is neither white space nor a separator; 0 at the end.
    fn peek(&mut self) -> u8 {
        while self.at < self.text.len() && b" \t\r\n,:".contains(&self.text[self.at]) {
            self.at += 1;
        }
        self.text.get(self.at).copied().unwrap_or(0)
    }

    fn value(&mut self) -> Json {
        match self.peek() {
            b'"' => Json::Text(self.string()),
            b'{' => {
                self.at += 1;
                let mut fields = Vec::new();
                while self.peek() == b'"' {
                    let key = self.string();
                    fields.push((key, self.value()));
                }
                self.at += 1;
                Json::Object(fields)
            }
            b'[' => {
                self.at += 1;
                let mut items = Vec::new();
                while !matches!(self.peek(), b']' | 0) {
                    items.push(self.value());
                }
                self.at += 1;
                Json::List(items)
            }
            _ => {
                let start = self.at;
                while self.at < self.text.len() && !b",]} \t\r\n".contains(&self.text[self.at]) {
                    self.at += 1;
                }
                match &self.text[start..self.at] {
                    b"true" => Json::Bool(true),
                    b"false" => Json::Bool(false),
                    word => String::from_utf8_lossy(word).parse().map_or(Json::Null, Json::Number),
                }
            }
        }
    }

    fn string(&mut self) -> String {
        let mut units: Vec<u16> = Vec::new(); // of \u escapes in a row, which may be pairs
        let mut bytes: Vec<u8> = Vec::new();
        self.at += 1;
        while self.at < self.text.len() && self.text[self.at] != b'"' {
            let (mut octet, mut escaped) = (self.text[self.at], None);
            if octet == b'\\' {
                self.at += 1;
                octet = match self.text[self.at] {
                    b'b' => 8,
                    b'f' => 12,
                    b'n' => 10,
                    b'r' => 13,
                    b't' => 9,
                    b'u' => {
                        let digits = String::from_utf8_lossy(&self.text[self.at + 1..self.at + 5]).into_owned();
                        escaped = u16::from_str_radix(&digits, 16).ok();
                        self.at += 4;
                        0
                    }
                    other => other,
                };
            }
            self.at += 1;
            if let Some(unit) = escaped {
                units.push(unit);
                continue;
            }
            bytes.extend(String::from_utf16_lossy(&units).bytes());
            units.clear();
            bytes.push(octet);
        }
        bytes.extend(String::from_utf16_lossy(&units).bytes());
        self.at += 1;
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// MAVLink's checksum: CRC-16/MCRF4XX.
fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0xffff, |value: u16, octet| {
        let mut low = octet ^ (value & 0xff) as u8;
        low ^= low << 4;
        let wide = low as u16;
        (value >> 8) ^ (wide << 8) ^ (wide << 3) ^ (wide >> 4)
    })
}

/// The autopilot behind REBAR_MAVLINK.
pub struct Vehicle {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    received: u64,
    pub sent: u64,
    pub is_ready: bool,
    pub is_armed: bool,
    autopilot: u8,
    pub height_m: f64,
    amsl_m: f64,
    latitude_deg: f64,
    longitude_deg: f64,
    /// Latitude, longitude and height of the mission's map.
    origin: [f64; 3],
}

impl Vehicle {
    fn open(address: &str) -> Vehicle {
        let socket = UdpSocket::bind(address.trim_start_matches("udpin:")).expect("MAVLink");
        Vehicle {
            socket,
            peer: None,
            received: 0,
            sent: 0,
            is_ready: false,
            is_armed: false,
            autopilot: 0,
            height_m: 0.0,
            amsl_m: 0.0,
            latitude_deg: 0.0,
            longitude_deg: 0.0,
            origin: [0.0; 3],
        }
    }

    /// What has come. Lockstep states in each tick how many frames were sent since the start: all of them are waited for.
    fn receive(&mut self, count: u64) {
        let mut data = [0; 65536];
        loop {
            self.socket.set_nonblocking(self.received >= count).expect("MAVLink");
            match self.socket.recv_from(&mut data) {
                Ok((size, peer)) => {
                    self.peer = Some(peer);
                    let mut at = 0;
                    while at < size {
                        let length = data[at + 1] as usize;
                        let mut payload = [0; 256]; // MAVLink leaves out zeros at the end of a payload
                        payload[..length].copy_from_slice(&data[at + 10..at + 10 + length]);
                        self.read(u32::from_le_bytes([data[at + 7], data[at + 8], data[at + 9], 0]), &payload);
                        self.received += 1;
                        // Header, payload, checksum, and a signature where there is one.
                        at += 12 + length + 13 * (data[at + 2] & 1) as usize;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => panic!("MAVLink: {error}"),
            }
        }
    }

    fn read(&mut self, message: u32, payload: &[u8]) {
        let word = |at: usize| i32::from_le_bytes(payload[at..at + 4].try_into().unwrap());
        match message {
            // HEARTBEAT, not of a ground station
            0 if payload[5] != 8 => (self.autopilot, self.is_armed) = (payload[5], payload[6] & 128 != 0),
            // SYS_STATUS: MAV_SYS_STATUS_PREARM_CHECK is healthy
            1 => self.is_ready = word(8) >> 28 & 1 != 0,
            // GLOBAL_POSITION_INT
            33 => {
                (self.latitude_deg, self.longitude_deg) = (word(4) as f64 * 1e-7, word(8) as f64 * 1e-7);
                (self.amsl_m, self.height_m) = (word(12) as f64 * 1e-3, word(16) as f64 * 1e-3);
            }
            _ => (),
        }
    }

    /// `extra` is the extra byte of the checksum, from MAVLink's definition of the message.
    fn send(&mut self, message: u8, extra: u8, payload: &[u8]) {
        let Some(peer) = self.peer else { return }; // nothing has come from it yet, so nobody knows where it listens
        let length = payload.iter().rposition(|octet| *octet != 0).unwrap_or(0) + 1;
        let mut frame = vec![0xfd, length as u8, 0, 0, self.sent as u8, OWN[0], OWN[1], message, 0, 0];
        frame.extend(&payload[..length]);
        let sum = crc(&[&frame[1..], &[extra]].concat());
        frame.extend(sum.to_le_bytes());
        let _ = self.socket.send_to(&frame, peer);
        self.sent += 1;
    }

    /// Once a second.
    pub fn heartbeat(&mut self) {
        self.send(0, 50, &[0, 0, 0, 0, 18, 8, 0, 4, 3]);
        if self.autopilot == ARDUPILOT && self.amsl_m == 0.0 {
            // It streams nothing of itself.
            self.command(511, [1.0, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0]);
            self.command(511, [33.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
    }

    /// COMMAND_LONG
    pub fn command(&mut self, number: u16, parameters: [f32; 7]) {
        let mut payload: Vec<u8> = parameters.iter().flat_map(|value| value.to_le_bytes()).collect();
        payload.extend(number.to_le_bytes());
        payload.extend([1, 1, 0]);
        self.send(76, 152, &payload);
    }

    pub fn arm(&mut self) {
        if self.autopilot == ARDUPILOT {
            self.command(176, [1.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0]); // GUIDED
        }
        self.command(400, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    pub fn take_off(&mut self, height_m: f64) {
        if self.autopilot == ARDUPILOT {
            self.command(22, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m as f32]);
        } else {
            let amsl_m = (self.amsl_m - self.height_m + height_m) as f32;
            self.command(22, [f32::NAN, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, amsl_m]);
        }
    }

    pub fn land(&mut self) {
        self.command(21, [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 0.0]);
    }

    /// DO_REPOSITION: the autopilot flies there by itself and stays.
    pub fn go_to(&mut self, goal: [f64; 2], height_m: f64, speed_mps: f64) {
        let [of_longitude_m, of_latitude_m] = self.metres_of_degree();
        let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
        let mut payload = floats(&[speed_mps as f32, 1.0, 0.0, f32::NAN]);
        payload.extend((((self.origin[0] + goal[1] / of_latitude_m) * 1e7).round() as i32).to_le_bytes());
        payload.extend((((self.origin[1] + goal[0] / of_longitude_m) * 1e7).round() as i32).to_le_bytes());
        payload.extend(floats(&[(self.amsl_m - self.height_m + height_m) as f32]));
        payload.extend([192, 0, 1, 1, 0, 0, 0]);
        self.send(75, 158, &payload);
    }

    /// East and north of the mission's origin, metres.
    pub fn place(&self) -> [f64; 2] {
        let [of_longitude_m, of_latitude_m] = self.metres_of_degree();
        [
            (self.longitude_deg - self.origin[1]) * of_longitude_m,
            (self.latitude_deg - self.origin[0]) * of_latitude_m,
        ]
    }

    /// Of longitude and of latitude, on a sphere: a centimetre in a hundred metres is enough for a search.
    fn metres_of_degree(&self) -> [f64; 2] {
        let metre = (EARTH_M + self.origin[2]).to_radians();
        [metre * self.origin[0].to_radians().cos(), metre]
    }
}

/// A detection thrown onto flat ground.
#[derive(Clone)]
pub struct Seen {
    pub class_label: String,
    pub confidence: f64,
    pub place: [f64; 2],
    /// In which it was seen: 1.
    pub frames: u32,
}

/// Of two places, metres.
pub fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Pixels to ground, by the latest pose and the camera's mount.
#[derive(Default)]
pub struct Eye {
    poses: HashMap<String, Json>,
    mount: Option<Json>,
    k: Vec<f64>,
}

impl Eye {
    /// Take in a message; the objects in it, if it holds detections.
    pub fn see(&mut self, topic: &str, message: &Json) -> Vec<Seen> {
        if topic == "/tf_static" {
            self.mount = message.list("transforms").first().cloned();
        } else if topic == "/tf" {
            for item in message.list("transforms") {
                self.poses.insert(item.text("child_frame_id").into(), item.get("transform").clone());
            }
        } else if topic.ends_with("/camera_info") {
            let number = |item: &Json| if let Json::Number(number) = item { *number } else { 0.0 };
            self.k = message.list("k").iter().map(number).collect();
        } else if topic.ends_with("/detections") {
            return message.list("detections").iter().filter_map(|detection| self.seen(detection)).collect();
        }
        Vec::new()
    }

    fn seen(&self, detection: &Json) -> Option<Seen> {
        let (bbox, best) = (detection.get("bbox"), detection.list("results").first()?.get("hypothesis"));
        let centre = bbox.get("center").get("position");
        // The middle of the lower edge stands on the ground.
        let place = self.ground(centre.number("x"), centre.number("y") + bbox.number("size_y") / 2.0)?;
        Some(Seen { class_label: best.text("class_id").into(), confidence: best.number("score"), place, frames: 1 })
    }

    /// Where a pixel of the main camera meets flat ground.
    pub fn ground(&self, x_px: f64, y_px: f64) -> Option<[f64; 2]> {
        let mount = self.mount.as_ref()?;
        let body = self.poses.get(mount.get("header").text("frame_id"))?;
        let k = self.k.get(..6)?;
        let ray = [(x_px - k[2]) / k[0], (y_px - k[5]) / k[4], 1.0];
        let ray = turned(body.get("rotation"), turned(mount.get("transform").get("rotation"), ray));
        let at = body.get("translation");
        let far = at.number("z") / -ray[2];
        (ray[2] <= -0.05).then(|| [at.number("x") + far * ray[0], at.number("y") + far * ray[1]])
    }
}

/// A vector turned by a quaternion as ROS writes it.
fn turned(q: &Json, v: [f64; 3]) -> [f64; 3] {
    let [x, y, z, w] = ["x", "y", "z", "w"].map(|key| q.number(key));
    let (a, b, c) = (2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0]));
    [v[0] + w * a + y * c - z * b, v[1] + w * b + z * a - x * c, v[2] + w * c + x * b - y * a]
}

/// The session: `while let Some(messages) = bench.tick()`, and `ack` at the end of each round.
pub struct Bench {
    vehicle_name: String,
    pub options: Json,
    pub vehicle: Vehicle,
    pub now_s: f64,
    lines: BufReader<TcpStream>,
    number: u64,
    outbox: Vec<String>,
}

impl Bench {
    /// Connect, and say which topics are read: `mission` is /VEHICLE/mission, `/tf` itself.
    pub fn open(agent: &str, topics: &[&str]) -> Bench {
        let given = |name: &str| env::var(name).unwrap_or_else(|_| panic!("the bench sets {name}"));
        let vehicle_name = given("REBAR_VEHICLE");
        let full = |topic: &&str| if topic.starts_with('/') { format!("{topic:?}") } else { format!("\"/{vehicle_name}/{topic}\"") };
        let vehicle = Vehicle::open(&given("REBAR_MAVLINK"));
        let connection = TcpStream::connect(given("REBAR_TICK")).expect("tick socket");
        connection.set_nodelay(true).expect("tick socket");
        let mut bench = Bench {
            options: Json::read(&given("REBAR_OPTIONS")),
            vehicle,
            now_s: 0.0,
            lines: BufReader::new(connection),
            number: 0,
            outbox: Vec::new(),
            vehicle_name: vehicle_name.clone(),
        };
        bench.say(format!(
            "{{\"kind\":\"hello\",\"protocol\":1,\"agent\":{agent:?},\"secret\":{:?},\"subscribes\":[{}]}}\n",
            given("REBAR_TICK_SECRET"),
            topics.iter().map(full).collect::<Vec<_>>().join(","),
        ));
        bench
    }

    fn say(&mut self, line: String) {
        // In one piece; it fails when the session is over, which the next line tells.
        let _ = self.lines.get_mut().write_all(line.as_bytes());
    }

    /// The messages of the next tick, each with its topic; None at the end of the session.
    pub fn tick(&mut self) -> Option<Vec<(String, Json)>> {
        let mut line = String::new();
        self.lines.read_line(&mut line).ok().filter(|size| *size > 0)?;
        let tick = Json::read(&line);
        if tick.text("kind") == "end" {
            println!("{}", tick.text("reason"));
            return None;
        }
        self.number = tick.number("number") as u64;
        self.now_s = tick.number("time_ns") * 1e-9;
        self.vehicle.receive(tick.get("links").number("onboard") as u64);
        let message = |item: &Json| (item.text("topic").to_string(), item.get("message").clone());
        let messages: Vec<_> = tick.list("air").iter().map(message).collect();
        if let Some((_, mission)) = messages.iter().find(|message| message.0.ends_with("/mission")) {
            self.vehicle.origin = ["latitude_deg", "longitude_deg", "altitude_m"].map(|key| mission.get("origin").number(key));
        }
        Some(messages)
    }

    /// Under /VEHICLE/agent/: reports, decisions, status, tracks, answers, consent_requests. `fields` is what stands in the
    /// document beside `time_s`: `"phase":"transit"`.
    pub fn publish(&mut self, topic: &str, fields: String) {
        let (vehicle, now_s) = (&self.vehicle_name, self.now_s);
        self.outbox.push(format!("{{\"topic\":\"/{vehicle}/agent/{topic}\",\"message\":{{\"time_s\":{now_s},{fields}}}}}"));
    }

    /// Answer the tick, with all messages.
    pub fn ack(&mut self) {
        let (number, sent, air) = (self.number, self.vehicle.sent, self.outbox.join(","));
        self.outbox.clear();
        self.say(format!("{{\"kind\":\"ack\",\"number\":{number},\"links\":{{\"onboard\":{sent}}},\"air\":[{air}]}}\n"));
    }
}
