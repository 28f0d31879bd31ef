"""The programs that run on the GPU. Colours are blue, green, red as everywhere in the bench.

Places are in the camera's optical frame, in metres: 32-bit floats are exact to a tenth of a millimetre there, and would
not be in a world of a hundred kilometres.
"""

from __future__ import annotations

_HEAD = "#version 430\n"

_LIGHT = """
uniform vec3 sunward;
uniform vec3 up;
uniform vec3 ambient;
uniform vec3 direct;
uniform vec3 haze;
uniform float extinction;
uniform int shadow_maps;
uniform sampler2DShadow near_map;
uniform sampler2DShadow far_map;
uniform mat4 near_sun;
uniform mat4 far_sun;
uniform vec2 shadow_texel_m;

float lit_share(sampler2DShadow map, mat4 sun, float texel_m, vec3 place, vec3 normal) {
    // Moved out of the surface by more than a texel, which would else shade itself.
    vec3 at = (sun * vec4(place + 1.5 * texel_m * normal, 1.0)).xyz * 0.5 + 0.5;
    if (any(lessThan(at.xy, vec2(0.0))) || any(greaterThan(at.xy, vec2(1.0)))) return 1.0;
    float depth = clamp(at.z - 0.0002, 0.0, 1.0);
    vec2 texel = 0.5 / vec2(textureSize(map, 0));
    float lit = 0.0;
    for (int i = 0; i < 4; ++i) {
        vec2 corner = vec2(i & 1, i >> 1) * 2.0 - 1.0;
        lit += texture(map, vec3(at.xy + corner * texel, depth));
    }
    return lit * 0.25;
}

vec3 shone(vec3 colour, vec3 place, vec3 normal) {
    float sun = max(0.0, dot(normal, sunward));
    if (sun > 0.0 && shadow_maps > 0) {
        sun *= min(
            lit_share(near_map, near_sun, shadow_texel_m.x, place, normal),
            lit_share(far_map, far_sun, shadow_texel_m.y, place, normal)
        );
    }
    // Walls see half of the sky, and the ground below reflects some.
    float sky = 0.75 + 0.25 * dot(normal, up);
    return colour * pow(sky * ambient + sun * direct, vec3(1.0 / 2.2));
}

vec3 through_air(vec3 colour, vec3 place) {
    return mix(haze, colour, exp(-extinction * length(place)));
}
"""

_MOTION = """
uniform sampler2D motions;
const int ROW = 1024;

vec4 motion_row(int actor, int row) {
    int at = actor * 3 + row;
    return texelFetch(motions, ivec2(at % ROW, at / ROW), 0);
}

mat4x3 motion(int actor) {
    return transpose(mat3x4(motion_row(actor, 0), motion_row(actor, 1), motion_row(actor, 2)));
}
"""

_PROJECT = """
uniform vec4 lens;
uniform vec2 depths;

vec4 projected(vec3 place) {
    // The first row of the buffer is the top of the picture, so y needs no flip.
    return vec4(lens.xy * place.xy + lens.zw * place.z, depths.x * place.z + depths.y, place.z);
}
"""

SOLID_VERTEX = (
    _HEAD
    + _MOTION
    + _PROJECT
    + """
in vec3 corner;
in vec3 normal;
in vec4 paint;
in int actor;
out vec3 place;
flat out vec3 facing;
flat out vec4 painted;
flat out int label;

void main() {
    mat4x3 moved = motion(actor);
    place = moved * vec4(corner, 1.0);
    facing = mat3(moved) * normal;
    painted = paint;
    label = actor + 1;
    gl_Position = projected(place);
}
"""
)

SOLID_COLOUR = (
    _HEAD
    + _LIGHT
    + """
in vec3 place;
flat in vec3 facing;
flat in vec4 painted;
uniform vec3 glow;
out vec4 colour;

void main() {
    vec3 shown = shone(painted.rgb, place, facing);
    if (painted.a > 0.5) shown = max(shown, glow);
    colour = vec4(through_air(shown, place), 1.0);
}
"""
)

SOLID_TRUTH = (
    _HEAD
    + """
in vec3 place;
flat in int label;
layout(location = 0) out uint instance;
layout(location = 1) out float depth_m;

void main() {
    instance = uint(label);
    depth_m = place.z;
}
"""
)

SHADOW_VERTEX = (
    _HEAD
    + _MOTION
    + """
in vec3 corner;
in int actor;
uniform mat4 sun;

void main() {
    gl_Position = sun * vec4(motion(actor) * vec4(corner, 1.0), 1.0);
}
"""
)

SHADOW_FRAGMENT = _HEAD + "void main() {}\n"

PICTURE_VERTEX = (
    _HEAD
    + """
in vec2 corner;

void main() {
    gl_Position = vec4(corner, 0.0, 1.0);
}
"""
)

_RAYS = """
uniform vec4 pinhole;
uniform float height;

vec3 ray() {
    return vec3((gl_FragCoord.xy - pinhole.zw) / pinhole.xy, 1.0);
}
"""

GROUND_COLOUR = (
    _HEAD
    + _LIGHT
    + _RAYS
    + """
uniform sampler2D ground;
uniform sampler2D detail;
uniform vec3 east;
uniform vec3 north;
uniform vec2 ground_corner;
uniform vec2 ground_size;
uniform vec2 detail_corner;
uniform float detail_size;
uniform vec3 zenith;
out vec4 colour;

// Several samples along the longer axis of the pixel's footprint. A driver's own anisotropic filter does the same, and
// takes ten times as long on the CPU (Mesa 22.3).
const float MOST_TAPS = 8.0;

vec3 earth_at(vec2 at, vec2 across, vec2 down) {
    vec2 texels = vec2(textureSize(ground, 0));
    float wide = length(across * texels), high = length(down * texels);
    vec2 axis = wide > high ? across : down;
    float taps = clamp(ceil(max(wide, high) / max(min(wide, high), 1.0)), 1.0, MOST_TAPS);
    float level = log2(max(max(wide, high) / taps, 1e-3));
    vec3 sum = vec3(0.0);
    for (float tap = 0.5; tap < taps; tap += 1.0) {
        // Beyond its border the ground is mirrored.
        vec2 mirrored = 1.0 - abs(1.0 - mod(at + axis * (tap / taps - 0.5), 2.0));
        sum += textureLod(ground, mirrored, level).rgb;
    }
    return sum / taps;
}

void main() {
    vec3 along = ray();
    float fall = -dot(along, up);
    vec3 place = along * (height / max(fall, 1e-4));
    vec2 from_camera = vec2(dot(place, east), -dot(place, north));
    vec2 at = (from_camera + ground_corner) / ground_size;
    vec3 earth = earth_at(at, dFdx(at), dFdy(at));
    vec2 fine_at = (from_camera + detail_corner) / detail_size;
    float fine = texture(detail, fine_at).r * (255.0 / 128.0);
    vec3 shown = through_air(shone(earth * fine, place, up), place);
    float sine = dot(along, up) / length(along);
    vec3 overhead = mix(haze, zenith, sqrt(clamp(sine / 0.8, 0.0, 1.0)));
    colour = vec4(fall > 1e-4 ? shown : overhead, 1.0);
}
"""
)

GROUND_TRUTH = (
    _HEAD
    + _RAYS
    + """
uniform vec3 up;
layout(location = 0) out uint instance;
layout(location = 1) out float depth_m;

void main() {
    float fall = -dot(ray(), up);
    instance = 0u;
    depth_m = fall > 1e-6 * height ? height / fall : uintBitsToFloat(0x7f800000u);
}
"""
)
