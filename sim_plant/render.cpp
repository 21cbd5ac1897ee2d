// The kernels that draw a picture of the field, float32 and free of any state of their own.
//
// Everything lies by columns of the picture, since stalks, and what a ray meets, run down columns:
// a stalk's rows share cache lines, and one column's pixels are worked on several at once. Plain
// loops over short arrays, which the compiler turns into vector instructions of whatever width
// there is; built without contraction or reassociation, so that every width gives the same bits.
//
// Each part of a picture (`prepare`: stalks of some blocks and profiles of some azimuths; `draw`:
// some columns) may run in a thread of its own. Their number is the same whatever the number of
// threads.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

namespace {

// Of sim_plant/field.py.
enum Kind { SOIL, CROP, STUBBLE, WINDROW, GRASS, NEIGHBOUR, NEIGHBOUR_STUBBLE, OBSTACLE, TRUNK };
// Of sim_plant/labels.py.
enum Label {
  L_BACKGROUND,
  L_STANDING,
  L_STUBBLE,
  L_STRAW,
  L_SOIL,
  L_NEIGHBOUR,
  L_WEEDS,
};
// Of sim_plant/texture.py.
enum Tile { T_SOIL, T_STUBBLE, T_STRAW, T_GRASS, T_TOP, T_WALL };
constexpr int SIDE = 1024;
constexpr float TEXEL_M = 0.004F;
constexpr int LEVELS = 8;
// Of sim_plant/sky.py.
constexpr float PANORAMA_TOP = 0.84F, PANORAMA_BOTTOM = -0.04F;
// Of sim_plant/camera.py: the blade's dust is drawn so much smaller.
constexpr int VEIL = 4;
// Of sim_plant/render.py.
constexpr double BLOCK_M = 0.5;
constexpr int PACKS = 64;
enum Channel { SUNLIT, HEIGHT, GREEN, DENSITY, WEED, LODGE, TONE, BODY, CHANNELS };
constexpr float UNIT = 1.0F / 4096.0F;
constexpr int SEGMENTS = 48, PIECES = 2 * SEGMENTS + 1;
constexpr double REACH_M = 16.0;
// Farther away a block shows the fewer of its stalks, and wider ones.
constexpr double ALL_SHOWN_M = 1.7;

// Pixels that are found but not painted yet, among the labels.
enum Met { SKY = 100, CANOPY, FACE, GROUND };
// How far behind its front the body of the crop lies: stalks fill the space between.
constexpr float CANOPY_BACK_M = 0.25F, FACE_BACK_M = 0.30F;
// Share of a stalk that other stalks leave to be seen where crop stands before it.
constexpr float INTERIOR = 0.42F;
constexpr float NEAREST_M = 0.25F, FARTHEST_M = 8191.0F;
// While stalks are drawn a pixel is one word, of which the smaller wins: in its upper half the
// depth, in its lower half the place of its colour in the strip's palette, or one of these: what
// its ray met, or that it has its colour.
constexpr uint32_t PALETTE = 0xFF00, MET = 0xFF00, PAINTED = 0xFF01;
constexpr float PI = 3.14159265358979F;
// Pixels are painted, and stalks projected, so many at once: loops of just this length become
// vector instructions without a remainder.
constexpr int BATCH = 16;
// Of a column, of at most 4096 px; not a power of two, so that several arrays fit into a cache's
// sets.
constexpr int ROOM = 4096 + 176;

// As numba computes sim_plant/noise.py: products keep their upper halves.
uint32_t mix(uint32_t a, uint32_t b, uint32_t c) {
  uint64_t h = (a * uint64_t(0x9E3779B1)) ^ (b * uint64_t(0x85EBCA77)) ^ (c * uint64_t(0xC2B2AE3D));
  h = uint32_t(h ^ (h >> 16)) * uint64_t(0x7FEB352D);
  h = uint32_t(h ^ (h >> 15)) * uint64_t(0x846CA68B);
  return uint32_t(h ^ (h >> 16));
}

double uniform(int a, int b, int c) {
  return mix(uint32_t(a), uint32_t(b), uint32_t(c)) * (1.0 / 4294967296.0);
}

double smooth(int seed, double x, double y) {
  const double i = std::floor(x), j = std::floor(y);
  double fx = x - i, fy = y - j;
  fx = fx * fx * (3.0 - 2.0 * fx);
  fy = fy * fy * (3.0 - 2.0 * fy);
  const int ii = int(i), jj = int(j);
  const double a = uniform(seed, ii, jj), b = uniform(seed, ii + 1, jj);
  const double c = uniform(seed, ii, jj + 1), d = uniform(seed, ii + 1, jj + 1);
  return (a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy;
}

bool standing(int kind) { return kind == CROP || kind == NEIGHBOUR; }
bool solid(int kind) { return kind == OBSTACLE || kind == TRUNK; }

template <typename T>
T limited(T x, T low, T high) {
  x = x < low ? low : x;
  return x < high ? x : high;
}

// A table of 256 floats would be shorter; but to gather from one takes longer than to compute.
constexpr int LIGHT_TERMS = 5;

// What a ray along the ground asks of a coarse cell, in one word of memory; `WAY` of render.py.
struct Way {
  uint16_t next, kinds;
};
// Of `Way::next`: less is a squared distance to the nearest body, in cells; from here on comes the
// height of the body that stands here.
constexpr int BODY_FROM = 1024;

// What its light and colour follow from; `LAND` of render.py.
struct Land {
  int32_t marks, looks;
};

// Of what the rays of one azimuth meet; `note_pieces` says what each is.
struct Piece {
  float limit, rise, back;
  uint32_t met;
};

// A stalk as it grows in a block; `GROWN` of render.py.
struct Grown {
  float x, y, height, lean_x, lean_y, shade, stub, nod, rank, blue, green, red;
};

// A stalk where it stands, as long as nothing near it is cut; in batches, field by field.
constexpr int SHADES = 4, STALK_COLOURS = 2 + SHADES;
enum Field {
  X,
  Y,
  TALLNESS,
  LEAN_X,
  LEAN_Y,
  SWAY,
  PHASE,
  STEM,
  EAR,
  NOD,
  HEAD,
  SHADOW,
  BLUE,
  GREENNESS,
  RED,
  WHAT,
  ORDER,
  FIELDS
};

// A stalk as it is drawn: px, but depths in m. What goes from the top down is a share of the
// length.
struct Stalk {
  float u0, v0, z0, u1, v1, z1;
  float stem, ear, ear_share, visible, nod;
  // Packed like a pixel: the ear's two stripes, and the stem's at four heights from the top down.
  uint32_t stripes[2], stems[SHADES];
};
constexpr int64_t PALETTE_STALKS = PALETTE / STALK_COLOURS;

}  // namespace

// `Picture` of render.py, which says what each is.
struct Picture {
  // The field.
  const uint8_t *kind;
  Way *way;
  Land *land;
  uint16_t *stand;
  const Grown *packs;
  float *grown;
  uint8_t *known;
  int32_t *grown_count;
  const double *crowns;
  // The paint.
  const int32_t *tiles;
  const int32_t *panorama;
  // Work.
  Piece *profiles;
  int32_t *pieces;
  int32_t *blocks;
  int64_t *first;
  int64_t *drawn;
  Stalk *stalks;
  int16_t *spans;
  int32_t *sorted;
  int64_t *dealt;
  uint8_t *image;
  uint8_t *labels;
  // A strip's own.
  float *depth;
  uint32_t *key;
  uint32_t *colour;

  double x0, y0, cell, canopy, tallest, roof;
  double x, y, z;
  double axes[9];
  double focal, cu, cv, k1, k2, shear, tangent, corner;
  double lens[4];
  double sun[3];
  double t, sway_x, sway_y, gust;
  double haze;
  double light[3][LIGHT_TERMS];
  double haze_bgr[3], crop_bgr[3], green_bgr[3], straw_bgr[3], unripe_loss[3];

  int64_t coarse_rows, coarse_columns;
  int64_t block_rows, block_columns;
  int64_t beyond_is_crop;
  int64_t pack_size, most;
  int64_t crown_count;
  int64_t tile_size;
  int64_t panorama_rows, panorama_columns;
  int64_t rows, columns;
  int64_t bins;
  int64_t block_count;
  int64_t capacity;
  int64_t seed;
  int64_t parts;
  int64_t stride;
  int64_t bin_from, bin_to;
};

namespace {

// The view's axes in the heading frame: (right, down, forward) by (ahead, left, up).
struct Heading {
  float ra, rl, rz, da, dl, dz, fa, fl, fz;
  double hx, hy;
  float azimuth;

  explicit Heading(const Picture &p) {
    const double norm = std::sqrt(p.axes[6] * p.axes[6] + p.axes[7] * p.axes[7]);
    hx = p.axes[6] / norm;
    hy = p.axes[7] / norm;
    azimuth = float(std::atan2(p.axes[7], p.axes[6]));
    float *out[3][3] = {{&ra, &rl, &rz}, {&da, &dl, &dz}, {&fa, &fl, &fz}};
    for (int k = 0; k < 3; ++k) {
      const double *axis = p.axes + 3 * k;
      *out[k][0] = float(axis[0] * hx + axis[1] * hy);
      *out[k][1] = float(axis[1] * hx - axis[0] * hy);
      *out[k][2] = float(axis[2]);
    }
  }
};

// The rays of a column of pixels: undistorted image coordinates to the right and down, normalised.
struct Rays {
  float u, cv, per_focal, shear, per_rows, lens[4];

  Rays(const Picture &p, int64_t column)
      : u(float((double(column) + 0.5 - p.cu) / p.focal)),
        cv(float(p.cv - 0.5)),
        per_focal(float(1.0 / p.focal)),
        shear(float(p.shear / p.focal)),
        per_rows(float(1.0 / double(p.rows))) {
    for (int k = 0; k < 4; ++k) lens[k] = float(p.lens[k]);
  }

  void at(int v, float &a, float &b) const {
    const float down = (float(v) - cv) * per_focal, r = u * u + down * down;
    const float ideal = 1.0F + r * (lens[0] + r * (lens[1] + r * (lens[2] + r * lens[3])));
    a = u * ideal - shear * ((float(v) + 0.5F) * per_rows - 0.5F);
    b = down * ideal;
  }
};

float bin_tangent(int64_t b, const Picture &p) {
  return float(((double(b) + 0.5) / double(p.bins) * 2.0 - 1.0) * p.tangent);
}

int fine_kind(const Picture &p, int j, int i) { return p.kind[j * 2 * p.coarse_columns + i]; }

// What the rays of one azimuth meet, by their slope (rise per horizontal distance): of a ray of bin
// b the first of `pieces[b]` pieces with slope < `limit` says what it meets and its depth: `rise`
// over the direction's z, plus `back` over its horizontal length. Piece `pieces[b]` is sky. Written
// down from the n + 1 distances at which another height begins.
void note_pieces(const Picture &p, int64_t b, const float *start, const float *top, int n) {
  const float eye = float(p.z);
  Piece *out = p.profiles + b * PIECES;
  int m = 0;
  float highest = -std::numeric_limits<float>::infinity();
  const auto add = [&](float limit, float rise, float back, uint32_t met) {
    out[m++] = {limit, rise, back, met};
  };
  for (int k = 0; k <= n; ++k) {
    const float rise = top[k] - eye;
    float limit = rise / std::max(start[k], 1e-6F);
    if (limit > highest) {
      highest = limit;
      add(limit, 0.0F, start[k] + FACE_BACK_M, FACE);
    }
    if (rise < 0.0F) {
      limit = rise / (k < n ? start[k + 1] : 240.0F);
      if (limit > highest) {
        highest = limit;
        add(limit, rise, top[k] > 0.0F ? CANOPY_BACK_M : 0.0F, top[k] > 0.0F ? CANOPY : GROUND);
      }
    }
  }
  add(std::numeric_limits<float>::infinity(), 0.0F, 1e9F, SKY);
  p.pieces[b] = m - 1;
}

// As many floats as a register of this processor holds: gcc would take wider vectors apart, many of
// their operations into single lanes.
#if defined(__AVX512F__)
constexpr int WIDTH = 16;
#elif defined(__AVX2__)
constexpr int WIDTH = 8;
#else
constexpr int WIDTH = 4;
#endif
typedef float Floats __attribute__((vector_size(4 * WIDTH)));
typedef int32_t Ints __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t Words __attribute__((vector_size(4 * WIDTH)));
typedef uint64_t Pairs __attribute__((vector_size(4 * WIDTH)));

Ints numbered() {
  Ints lanes = {};
  for (int k = 0; k < WIDTH; ++k) lanes[k] = k;
  return lanes;
}

const Ints LANES = numbered();
const Floats LANES_F = __builtin_convertvector(LANES, Floats) + 0.5F;
// Makes truncation of a column a floor.
constexpr float COLUMNS = 4096.0F;

Floats larger(Floats a, Floats b) { return a > b ? a : b; }

Floats between(Floats x, float low, float high) {
  x = x < low ? Floats{} + low : x;
  return x < high ? x : Floats{} + high;
}

// Whether a lane of a comparison is true.
template <typename T>
bool any(T of) {
  const Words x = (Words)of;
  uint32_t sum = 0;
  for (int k = 0; k < WIDTH; ++k) sum |= x[k];
  return sum != 0;
}

// From one corner of a cell to the far one, and rounding, in cells.
constexpr double DIAGONAL = 1.4143;
// No free distance is looked for beyond.
constexpr float CAP_M = 1.0F;

// The profiles of WIDTH bins on their way outward. Free ground is crossed by leaps of the clear
// distance, crop by steps of 8 cm and more with the distance.
struct March {
  const Picture *p;
  int64_t b0, b1;
  float px0, py0, roof, half_cell, eye, coarse;
  Floats dx, dy, r, hidden, now, px, py;
  Ints going, n;
  int32_t cells[WIDTH];
  float start[WIDTH][SEGMENTS], top[WIDTH][SEGMENTS];

  // The bins [first, end), WIDTH of them at most. The azimuth of bin b is atan(bin_tangent(b)) to
  // the left of the heading.
  void begin(const Picture &of, const Heading &head, int64_t first, int64_t end) {
    p = &of;
    b0 = first;
    b1 = end;
    const float inv = float(0.5 / of.cell);
    px0 = float((of.x - of.x0) * 0.5 / of.cell);
    py0 = float((of.y - of.y0) * 0.5 / of.cell);
    half_cell = float(0.5 * of.cell);
    coarse = float(2.0 * of.cell);
    eye = float(of.z);
    roof = float(of.roof) + 0.1F - eye;
    r = hidden = Floats{};
    now = Floats{} - 1.0F;
    going = Ints{} - 1;
    n = Ints{};
    for (int k = 0; k < WIDTH; ++k) {
      const float lateral = bin_tangent(std::min(b0 + k, b1 - 1), of);
      const float stretch = std::sqrt(1.0F + lateral * lateral);
      dx[k] = (float(head.hx) - lateral * float(head.hy)) / stretch * inv;
      dy[k] = (float(head.hy) + lateral * float(head.hx)) / stretch * inv;
    }
  }

  // Asks for the cells that the rays have come to.
  void look() {
    const float n_i = float(p->coarse_columns), n_j = float(p->coarse_rows);
    px = px0 + r * dx;
    py = py0 + r * dy;
    going &= (px >= 0.0F) & (py >= 0.0F) & (px < n_i) & (py < n_j);
    const Ints i = __builtin_convertvector(between(px, 0.0F, n_i - 1.0F), Ints);
    const Ints j = __builtin_convertvector(between(py, 0.0F, n_j - 1.0F), Ints);
    const Ints at = j * int(p->coarse_columns) + i;
    int32_t places[WIDTH];
    std::memcpy(places, &at, sizeof at);
    for (int k = 0; k < WIDTH; ++k) std::memcpy(cells + k, p->way + places[k], sizeof(Way));
  }

  // Notes what stands there and goes on; returns whether a ray still goes.
  bool step() {
    Ints cell;
    std::memcpy(&cell, cells, sizeof cell);
    const Ints next = cell & 0xFFFF;
    const Floats body =
        __builtin_convertvector(next < BODY_FROM ? Ints{} : next - BODY_FROM, Floats);
    const Floats squared = __builtin_convertvector(next, Floats);
    float away[WIDTH];
    std::memcpy(away, &squared, sizeof away);
    for (int k = 0; k < WIDTH; ++k) away[k] = std::sqrt(away[k]);
    Floats clear;
    std::memcpy(&clear, away, sizeof away);
    clear = body > 0.0F ? Floats{} : between((clear - float(DIAGONAL)) * coarse, 0.0F, CAP_M);
    const Ints quarter = 2 * (__builtin_convertvector(2.0F * py, Ints) & 1) +
                         (__builtin_convertvector(2.0F * px, Ints) & 1);
    const Ints kind = cell >> (16 + 4 * quarter) & 15;
    const Ints free = clear > 0.0F, here = ~free & (body > 0.0F);
    const Ints crop = here & ((kind == int(CROP)) | (kind == int(NEIGHBOUR)));
    const Ints thing = here & ((kind == int(OBSTACLE)) | (kind == int(TRUNK)));
    const Floats high = UNIT * body;
    const Floats height = crop ? 0.8F * high : thing ? high : Floats{};
    // Along an edge the distance to it would make the steps too many.
    const Floats over = larger(clear + 0.005F, 0.008F * r);
    const Floats leap = free ? over : crop ? 0.08F + 0.03F * r : Floats{} + half_cell;
    // Nothing farther away rises above what stands here.
    going &= ~((hidden > 0.0F) & (roof <= hidden * r));
    const Floats other = height - now;
    const Ints fresh = going & ((now < 0.0F) | ((height > 0.0F) ^ (now > 0.0F)) | (other > 0.06F) |
                                (other < -0.06F));
    if (any(fresh))
      for (int k = 0; k < WIDTH; ++k)
        if (fresh[k]) note(k, height[k], leap[k]);
    r = going ? r + leap : r;
    going &= (n < SEGMENTS - 1) & (r < 80.0F);
    return any(going);
  }

  void note(int k, float height, float leap) {
    float high = height;
    // The crop's upper border is ragged.
    if ((high > 0.0F) != (now[k] > 0.0F) && high > 0.0F && leap > half_cell)
      high += 0.16F * float(uniform(5, int(30.0F * px[k]), int(30.0F * py[k]))) - 0.10F;
    start[k][n[k]] = r[k];
    top[k][n[k]] = high;
    ++n[k];
    hidden[k] = std::max(hidden[k], (high - eye) / std::max(r[k], 1e-6F));
    now[k] = height;
  }

  void end() {
    for (int k = 0; k < int(b1 - b0); ++k) {
      start[k][n[k]] = r[k];
      top[k][n[k]] = p->beyond_is_crop ? float(p->canopy) : 0.0F;
      note_pieces(*p, b0 + k, start[k], top[k], n[k]);
    }
  }
};

// The profiles of the bins [b0, b1), MARCHES * WIDTH of them at most: while the cells of one march
// come from memory, the others go on.
constexpr int MARCHES = 6;
void profile(const Picture &p, const Heading &head, int64_t b0, int64_t b1) {
  March marches[MARCHES];
  int on_the_way[MARCHES], count = 0;
  for (int64_t b = b0; b < b1; b += WIDTH) {
    marches[count].begin(p, head, b, std::min(b + WIDTH, b1));
    on_the_way[count] = count;
    ++count;
  }
  const int all = count;
  while (count > 0) {
    for (int k = 0; k < count; ++k) marches[on_the_way[k]].look();
    int left = 0;
    for (int k = 0; k < count; ++k) {
      const int which = on_the_way[k];
      if (marches[which].step()) on_the_way[left++] = which;
    }
    count = left;
  }
  for (int k = 0; k < all; ++k) marches[k].end();
}

// Looks up what stands in a block, once until something near it changes.
void grow(const Picture &p, int64_t block) {
  const int bj = int(block / p.block_columns), bi = int(block % p.block_columns);
  const int rows = int(2 * p.coarse_rows), columns = int(2 * p.coarse_columns);
  const Grown *pack = p.packs + size_t(mix(uint32_t(p.seed), uint32_t(bi), uint32_t(bj)) % PACKS) *
                                    size_t(p.pack_size);
  float *out = p.grown + size_t(block) * FIELDS * size_t(p.most);
  const auto put = [&](Field which, int n, float value) {
    out[(n / BATCH * FIELDS + which) * BATCH + n % BATCH] = value;
  };
  const double inv = 1.0 / p.cell;
  int n = 0;
  for (int q = 0; q < p.pack_size; ++q) {
    const Grown &s = pack[q];
    const int i = int((bi * BLOCK_M + double(s.x)) * inv),
              j = int((bj * BLOCK_M + double(s.y)) * inv);
    if (i >= columns || j >= rows) continue;
    const int kind = fine_kind(p, j, i);
    const uint16_t *cell =
        p.stand + (size_t(j / 2) * size_t(p.coarse_columns) + size_t(i / 2)) * CHANNELS;
    if (kind == SOIL || solid(kind) || s.rank > UNIT * cell[DENSITY]) continue;
    const bool tall = standing(kind);
    float lean_x = s.lean_x, lean_y = s.lean_y, height, head = 0.0F;
    int label;
    if (tall) {
      height = UNIT * cell[HEIGHT] * s.height;
      const float lodge = UNIT * cell[LODGE];
      if (lodge > 0.05F) {
        const double lean = std::tan(double(lodge)), way = 6.28 * double(UNIT * cell[TONE]);
        lean_x += float(lean * std::cos(way));
        lean_y += float(lean * std::sin(way));
      }
      head = 0.085F / std::max(height, 0.1F);
      label = kind == CROP ? L_STANDING : L_NEIGHBOUR;
    } else {
      float spread = 2.5F;
      height = 0.07F + 0.07F * s.stub;
      label = L_STUBBLE;
      if (kind == WINDROW) {
        if (s.rank > 0.75F) continue;
        height = 0.02F + 0.10F * s.stub;
        spread = 40.0F;
        label = L_STRAW;
      } else if (kind == GRASS) {
        if (s.rank > 0.5F) continue;
        height = 0.03F + 0.09F * s.stub;
        spread = 8.0F;
        label = L_WEEDS;
      }
      lean_x *= spread;
      lean_y *= spread;
    }
    float shade = s.shade * (0.86F + 0.28F * UNIT * cell[TONE]), green = 0.0F;
    if (!tall) shade *= 1.12F;
    if (tall) {
      green = UNIT * cell[GREEN] * (0.75F + 0.5F * s.stub);
      if (UNIT * cell[WEED] > 0.3F && s.rank < 0.5F) green = 1.0F;
      green = std::min(1.0F, green);
    } else if (kind == GRASS) {
      green = 1.0F;
    }
    const double *ripe = tall ? p.crop_bgr : p.straw_bgr;
    const auto tinted = [&](int c, float tint) {
      return shade * (float(ripe[c]) + green * float(p.green_bgr[c] - ripe[c])) * tint;
    };
    put(X, n, s.x);
    put(Y, n, s.y);
    put(TALLNESS, n, height);
    put(LEAN_X, n, lean_x);
    put(LEAN_Y, n, lean_y);
    put(SWAY, n, tall ? 1.0F : 0.0F);
    put(PHASE, n, 37.0F * s.rank);
    put(STEM, n, tall ? 0.0019F : 0.0026F);
    put(EAR, n, tall ? 0.0050F : 0.0F);
    put(NOD, n, tall ? s.nod : 0.0F);
    put(HEAD, n, head);
    put(SHADOW, n, UNIT * cell[SUNLIT]);
    put(BLUE, n, tinted(0, s.blue));
    put(GREENNESS, n, tinted(1, s.green));
    put(RED, n, tinted(2, s.red));
    put(WHAT, n, float(label));
    put(ORDER, n, float(q));
    ++n;
  }
  p.grown_count[block] = n;
  p.known[block] = 1;
}

inline uint32_t packed(float blue, float green, float red) {
  return uint32_t(int32_t(std::min(255.0F, blue))) |
         uint32_t(int32_t(std::min(255.0F, green))) << 8 |
         uint32_t(int32_t(std::min(255.0F, red))) << 16;
}

// The factor on a colour of what sees a share of the sun.
struct Light {
  float terms[3][LIGHT_TERMS];

  explicit Light(const double (&of)[3][LIGHT_TERMS]) {
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < LIGHT_TERMS; ++k) terms[c][k] = float(of[c][k]);
  }

  float on(int c, float seen) const {
    const float *t = terms[c];
    return t[0] + seen * (t[1] + seen * (t[2] + seen * (t[3] + seen * t[4])));
  }
};

// Projects the stalks of one block in view to `out` and `spans`; returns how many are in the
// picture.
int64_t project(const Picture &p, int64_t k, Stalk *out, int16_t *spans) {
  const int64_t block = p.blocks[k];
  if (!p.known[block]) grow(p, block);
  const int bj = int(block / p.block_columns), bi = int(block % p.block_columns);
  const int64_t shown = p.first[k + 1] - p.first[k];
  const float *in = p.grown + size_t(block) * FIELDS * size_t(p.most);
  const int count = p.grown_count[block];
  if (count == 0) return 0;
  const double x_block = p.x0 + bi * BLOCK_M, y_block = p.y0 + bj * BLOCK_M;
  const float wider = std::min(4.6F, float(p.pack_size) / float(std::max<int64_t>(1, shown)));
  const float wave = float(0.55 + 0.45 * std::sin(1.3 * x_block + 0.7 * y_block - 2.2 * p.t));
  const float x_off = float(x_block - p.x), y_off = float(y_block - p.y), az = float(-p.z);
  const float clock = float(std::fmod(1.1 * p.t, 1.0)), gust = float(p.gust);
  const float sway_x = float(p.sway_x), sway_y = float(p.sway_y);
  float R[9];
  for (int q = 0; q < 9; ++q) R[q] = float(p.axes[q]);
  const float focal = float(p.focal), k1 = float(p.k1), k2 = float(p.k2);
  const float cu = float(p.cu), cv = float(p.cv), shear = float(p.shear);
  const float rows = float(p.rows), columns = float(p.columns), per_rows = 1.0F / float(p.rows);
  const float to_cell = float(1.0 / p.cell);
  const float cell_x = float((p.x - p.x0) / p.cell), cell_y = float((p.y - p.y0) / p.cell);
  const int fine_columns = int(2 * p.coarse_columns), fine_rows = int(2 * p.coarse_rows);

  constexpr int WIDE = BATCH;
  float u0[WIDE], v0[WIDE], z0[WIDE], u1[WIDE], v1[WIDE], z1[WIDE], reach[WIDE];
  int32_t seen[WIDE], before[WIDE], hides[WIDE];
  uint32_t paint[2 + SHADES][WIDE + 16];
  const Light light(p.light);
  const float haze = float(p.haze);
  const float hb = float(p.haze_bgr[0]), hg = float(p.haze_bgr[1]), hr = float(p.haze_bgr[2]);
  int64_t n = 0;
  for (int base = 0; base < count; base += WIDE) {
    // Beyond the count there is room, and something of no meaning.
    const float *f = in + base * FIELDS;
    constexpr int row = BATCH;
    int m = std::min(WIDE, count - base);
    // Of the pack only its first are shown.
    while (m > 0 && f[ORDER * row + m - 1] >= float(shown)) --m;
    if (m == 0) break;
    for (int q = 0; q < WIDE; ++q) {
      const float height = f[TALLNESS * row + q];
      const float phase = clock + f[PHASE * row + q];
      const float flutter = 4.0F * std::abs(phase - float(int(phase)) - 0.5F) - 1.0F;
      const float bend = (wave + gust * flutter) * f[SWAY * row + q];
      const float ax = x_off + f[X * row + q], ay = y_off + f[Y * row + q];
      const float bx = ax + height * (f[LEAN_X * row + q] + sway_x * bend);
      const float by = ay + height * (f[LEAN_Y * row + q] + sway_y * bend);
      const float bz = az + height;
      z0[q] = R[6] * ax + R[7] * ay + R[8] * az;
      z1[q] = R[6] * bx + R[7] * by + R[8] * bz;
      const float per_z0 = 1.0F / z0[q], per_z1 = 1.0F / z1[q];
      const float a0 = (R[0] * ax + R[1] * ay + R[2] * az) * per_z0;
      const float b0 = (R[3] * ax + R[4] * ay + R[5] * az) * per_z0;
      const float a1 = (R[0] * bx + R[1] * by + R[2] * bz) * per_z1;
      const float b1 = (R[3] * bx + R[4] * by + R[5] * bz) * per_z1;
      // Beyond twice the picture's corner the distortion polynomial is meaningless.
      const float r0 = std::min(a0 * a0 + b0 * b0, 2.0F), r1 = std::min(a1 * a1 + b1 * b1, 2.0F);
      const float g0 = focal * (1.0F + r0 * (k1 + r0 * k2));
      const float g1 = focal * (1.0F + r1 * (k1 + r1 * k2));
      v0[q] = b0 * g0 + cv;
      v1[q] = b1 * g1 + cv;
      u0[q] = a0 * g0 + cu + shear * (v0[q] * per_rows - 0.5F);
      u1[q] = a1 * g1 + cu + shear * (v1[q] * per_rows - 0.5F);
      const float low = std::min(u0[q], u1[q]), high = std::max(u0[q], u1[q]);
      seen[q] = int(z0[q] >= 0.3F) & int(z1[q] >= 0.3F) & int(v1[q] <= rows) & int(v0[q] >= 0.0F) &
                int(v0[q] - v1[q] >= 0.7F) & int(low <= columns + 8.0F) & int(high >= -8.0F);
      reach[q] = focal * per_z1 * wider;
      // Where crop that hides all but the top would stand, 0.45 m nearer.
      const float near = 0.45F / std::sqrt(ax * ax + ay * ay);
      const int ni =
          int(limited(cell_x + (ax - near * ax) * to_cell, 0.0F, float(fine_columns - 1)));
      const int nj = int(limited(cell_y + (ay - near * ay) * to_cell, 0.0F, float(fine_rows - 1)));
      before[q] = nj * fine_columns + ni;
    }
    int32_t some = 0;
    for (int q = 0; q < m; ++q) some |= seen[q];
    if (!some) continue;
    for (int q = 0; q < WIDE; ++q)
      hides[q] = (f[SWAY * row + q] > 0.0F) & int(standing(p.kind[before[q]]));
    for (int shade = 0; shade < 2 + SHADES; ++shade) {
      const bool ear = shade < 2;
      const float stripe = shade == 0 ? 0.92F : 1.08F, share = (float(shade) - 1.5F) / SHADES;
      for (int q = 0; q < WIDE; ++q) {
        // How far above the shadow's border the top is, x 4, plus 0.4.
        const float height = f[TALLNESS * row + q], head = f[HEAD * row + q];
        const float lit = 4.0F * (height - f[SHADOW * row + q]) + 0.4F;
        const float visible = hides[q] ? INTERIOR : 1.0F, darker = 0.22F * visible;
        const float shaded = head > 0.0F ? 0.22F : 0.0F, stem_gain = head > 0.0F ? 0.93F : 1.0F;
        const float thick = 0.5F * (z0[q] + z1[q]) * haze, fog = thick / (1.0F + thick);
        // Share of the length, from the top.
        const float a = ear ? 0.5F * head : head + (visible - head) * share;
        const float gain = (ear ? stripe : stem_gain) * (1.0F - darker * a) * (1.0F - fog);
        const float sun = limited(lit - 4.0F * height * a, shaded, 1.0F);
        paint[shade][q] = uint32_t(int32_t(f[WHAT * row + q])) << 24 |
                          packed(f[BLUE * row + q] * gain * light.on(0, sun) + fog * hb,
                                 f[GREENNESS * row + q] * gain * light.on(1, sun) + fog * hg,
                                 f[RED * row + q] * gain * light.on(2, sun) + fog * hr);
      }
    }
    for (int q = 0; q < m; ++q) {
      if (!seen[q]) continue;
      Stalk &e = out[n];
      e.u0 = u0[q];
      e.v0 = v0[q];
      e.z0 = z0[q];
      e.u1 = u1[q];
      e.v1 = v1[q];
      e.z1 = z1[q];
      e.stem = f[STEM * row + q] * reach[q];
      e.ear = f[EAR * row + q] * reach[q];
      e.nod = f[NOD * row + q] * reach[q] / wider;
      e.ear_share = f[HEAD * row + q];
      e.visible = hides[q] ? INTERIOR : 1.0F;
      e.stripes[0] = paint[0][q];
      e.stripes[1] = paint[1][q];
      for (int shade = 0; shade < SHADES; ++shade) e.stems[shade] = paint[2 + shade][q];
      const float wide = std::max(e.stem, e.ear) + std::abs(e.nod) + 1.5F;
      spans[2 * n] = int16_t(std::max(-32e3F, std::min(u0[q], u1[q]) - wide));
      spans[2 * n + 1] = int16_t(std::min(32e3F, std::max(u0[q], u1[q]) + wide));
      ++n;
    }
  }
  return n;
}

inline float from_bits(int32_t bits) {
  float x;
  std::memcpy(&x, &bits, 4);
  return x;
}

inline int32_t bits_of(float x) {
  int32_t bits;
  std::memcpy(&bits, &x, 4);
  return bits;
}

// A depth between NEAREST_M and FARTHEST_M as the upper half of a pixel's word: to 1/4096 of it.
constexpr int DEPTH_SHIFT = 11, DEPTH_NONE = 0x3E800000 >> DEPTH_SHIFT;

inline uint32_t depth_key(float depth) {
  const float z = limited(depth, NEAREST_M, FARTHEST_M);
  return uint32_t((bits_of(z) >> DEPTH_SHIFT) - DEPTH_NONE) << 16;
}

// Where the rays of two columns end, from the profile of each one's azimuth. The depth is the
// distance along the optical axis, a little behind canopy and face so that the foremost stalks
// stand out; the key says what was met. The rays of two columns and two rows always meet the same.
void find(const Picture &p, const Heading &h, int64_t u, int64_t columns) {
  const int rows = int(p.rows + 1) & ~1;
  const float one = 1.0F, tiny = 1e-7F;
  const float tangent = float(p.tangent), to_bin = float(0.5 * double(p.bins) / p.tangent);
  const float most = float(p.bins - 1);
  float up[2][ROOM], per_flat[ROOM];
  float rise[ROOM], back[ROOM];
  int32_t bin[ROOM];
  uint32_t met[ROOM];
  const Rays first(p, u), second(p, u + columns - 1);
  for (int v = 0; v < rows; ++v) {
    float a, b;
    first.at(v, a, b);
    const float per_ahead = one / std::max(tiny, a * h.ra + b * h.da + h.fa);
    const float lateral = (a * h.rl + b * h.dl + h.fl) * per_ahead;
    const float z = a * h.rz + b * h.dz + h.fz;
    up[0][v] = std::abs(z) > tiny ? z : -tiny;
    per_flat[v] = per_ahead / std::sqrt(one + lateral * lateral);
    bin[v] = int32_t(limited((lateral + tangent) * to_bin, 0.0F, most));
  }
  for (int v = 0; v < rows; ++v) {
    float a, b;
    second.at(v, a, b);
    const float z = a * h.rz + b * h.dz + h.fz;
    up[1][v] = std::abs(z) > tiny ? z : -tiny;
  }
  float slope[ROOM / 2], rises[ROOM / 2], backs[ROOM / 2];
  int32_t azimuth[ROOM / 2];
  uint32_t mets[ROOM / 2];
  for (int k = 0; k < rows / 2; ++k) {
    slope[k] = up[0][2 * k] * per_flat[2 * k];
    azimuth[k] = bin[2 * k];
  }
  const Piece *meets = nullptr;
  Piece piece = {};
  int at = 0, before = -1;
  float least = 0.0F;
  for (int k = 0; k < rows / 2; ++k) {
    // Most squares meet what the one above met.
    if (azimuth[k] != before || slope[k] < least || slope[k] >= piece.limit) {
      if (azimuth[k] != before) {
        before = azimuth[k];
        meets = p.profiles + before * PIECES;
        at = std::min(at, p.pieces[before]);
      }
      while (at > 0 && slope[k] < meets[at - 1].limit) --at;
      while (slope[k] >= meets[at].limit) ++at;
      piece = meets[at];
      least = at > 0 ? meets[at - 1].limit : -std::numeric_limits<float>::infinity();
    }
    rises[k] = piece.rise;
    backs[k] = piece.back;
    mets[k] = MET | piece.met;
  }
  for (int k = 0; k < rows / 2; ++k) {
    rise[2 * k] = rise[2 * k + 1] = rises[k];
    back[2 * k] = back[2 * k + 1] = backs[k];
    met[2 * k] = met[2 * k + 1] = mets[k];
  }
  for (int64_t c = 0; c < columns; ++c) {
    float *depth = p.depth + (u + c) * p.stride;
    uint32_t *key = p.key + (u + c) * p.stride;
    for (int v = 0; v < rows; ++v) {
      const float far = std::abs(rise[v] / up[c][v]) + back[v] * per_flat[v];
      depth[v] = std::min(far, FARTHEST_M);
      key[v] = depth_key(far) | met[v];
    }
  }
}

// Draws the trees' crowns into columns [left, right): balls of leaves, lit from above.
void draw_crowns(const Picture &p, int64_t left, int64_t right) {
  const Light light(p.light);
  const int64_t rows = p.rows;
  const double *R = p.axes;
  for (int64_t k = 0; k < p.crown_count; ++k) {
    const double *crown = p.crowns + 4 * k;
    const double ax = crown[0] - p.x, ay = crown[1] - p.y, az = crown[2] - p.z;
    const double z = R[6] * ax + R[7] * ay + R[8] * az;
    if (z < 0.5) continue;
    const double uc = p.focal * (R[0] * ax + R[1] * ay + R[2] * az) / z + p.cu;
    const double vc = p.focal * (R[3] * ax + R[4] * ay + R[5] * az) / z + p.cv;
    const double radius = p.focal * crown[3] / z, leaf = 40.0 / radius;
    const double fog = p.haze * z / (1.0 + p.haze * z);
    const uint32_t deep = depth_key(float(z));
    const auto from = [](double x, int64_t least) {
      return std::max(least, int64_t(std::max(-1e6, x)));
    };
    const auto until = [](double x, int64_t most) {
      return std::min(most, int64_t(std::max(-1.0, std::min(1e6, x))) + 1);
    };
    for (int64_t u = from(uc - radius, left); u < until(uc + radius, right); ++u) {
      for (int64_t v = from(vc - radius, 0); v < until(vc + radius, rows); ++v) {
        const double dx = (double(u) - uc) / radius, dy = (double(v) - vc) / radius;
        if (dx * dx + dy * dy > 1.2 || deep >= (p.key[u * p.stride + v] | 0xFFFF)) continue;
        const double clump = smooth(int(k) + 7, dx * 4.0 + 9.0, dy * 4.0 + 9.0);
        const double fine =
            smooth(int(k) + 8, (double(u) - uc) * leaf + 99.0, (double(v) - vc) * leaf + 99.0);
        if (dx * dx + dy * dy > 0.45 + 0.5 * clump + 0.25 * fine) continue;
        const float lit = float(limited(0.55 - 0.5 * dy + 0.9 * (clump + fine - 1.0), 0.0, 1.0));
        float bgr[3];
        const double leaves[3] = {42.0, 84.0, 66.0};
        for (int c = 0; c < 3; ++c) {
          const double x = leaves[c] * (0.7 + 0.6 * fine) * double(light.on(c, lit));
          bgr[c] = float(x + fog * (p.haze_bgr[c] - x));
        }
        p.key[u * p.stride + v] = deep | PAINTED;
        p.colour[u * p.stride + v] = uint32_t(L_BACKGROUND) << 24 | packed(bgr[0], bgr[1], bgr[2]);
      }
    }
  }
}

// Columns that are drawn together: most stalks cover fewer, and how many is hard to foresee.
constexpr int AT_ONCE = 4;

// Draws WIDTH rows from v on, the first n of them: in each the columns from `from` on that lie
// before `to`, at least one, where nothing nearer was drawn. All of them lie in [low, high), and
// `from` and `to` are COLUMNS larger than columns.
inline void paint(const Picture &p, int v, int n, Floats from, Floats to, Floats z, Words with,
                  int low, int high) {
  const Ints a = __builtin_convertvector(from, Ints);
  Ints b = __builtin_convertvector(to, Ints) - a;
  b = b > 1 ? b : Ints{} + 1;
  b = LANES < n ? b : Ints{};
  const Words wide = (Words)b, here = (Words)a - uint32_t(COLUMNS);
  const Words key = (Words)(((Ints)z >> DEPTH_SHIFT) - DEPTH_NONE) << 16 | with;
  const int64_t stride = p.stride;
  uint32_t *at = p.key + low * stride + v;
  for (int u = low; u < high; u += AT_ONCE, at += AT_ONCE * stride) {
    Words there[AT_ONCE];
    for (int k = 0; k < AT_ONCE; ++k) std::memcpy(&there[k], at + k * stride, sizeof there[k]);
    for (int k = 0; k < AT_ONCE; ++k) {
      const Words fresh = (uint32_t(u + k) - here) < wide ? key : there[k];
      there[k] = fresh < there[k] ? fresh : there[k];
    }
    for (int k = 0; k < AT_ONCE; ++k) std::memcpy(at + k * stride, &there[k], sizeof there[k]);
  }
}

// `place`: of the stalk's first colour in the strip's palette.
void draw_stalk(const Picture &p, const Stalk &e, uint32_t place, int left, int right) {
  const int rows = int(p.rows);
  const float lengthwise = e.v0 - e.v1, per = 1.0F / lengthwise;
  const float du = (e.u0 - e.u1) * per, dz = (e.z0 - e.z1) * per, slant = 0.5F * std::abs(du);
  const int va = std::max(0, int(std::ceil(std::max(e.v1, -9.0F) - 0.5F)));
  // Interior crop sinks into its body.
  int vb = rows - 1;
  if (e.v0 - 0.5F < float(vb)) vb = int(std::floor(e.v0 - 0.5F));
  if (e.v1 + lengthwise * e.visible < float(vb)) vb = int(e.v1 + lengthwise * e.visible);
  if (va > vb) return;
  int vh = va;
  if (e.ear_share > 0.0F)
    vh = std::min(vb + 1, std::max(va, int(std::ceil(e.v1 - 0.5F + e.ear_share * lengthwise))));
  const float base = e.u1 + (0.5F + COLUMNS);
  // The columns between two of them, and at least one.
  const auto columns = [&](float from, float to, int &low, int &high) {
    low = std::max(left, int(from) - int(COLUMNS));
    high = std::min(right, std::max(int(from) + 1, int(to)) - int(COLUMNS));
  };
  int low, high;
  if (va < vh) {
    const float per_head = per / e.ear_share, wide = std::max(slant, e.ear);
    const int ears = int(e.u1);
    for (int v = va; v < vh; v += WIDTH) {
      const int n = std::min(WIDTH, vh - v);
      const float first = 0.5F + (float(v) - e.v1), last = (float(n) - 0.5F) + (float(v) - e.v1);
      // The nod falls from the first row to the last, and the slant adds to it or takes from it.
      const float rest_a = 1.0F - std::max(0.0F, first * per_head);
      const float rest_b = 1.0F - std::max(0.0F, last * per_head);
      const float a = du * first, b = du * last;
      const float c = e.nod * rest_a * rest_a, d = e.nod * rest_b * rest_b;
      columns(base + std::min(a, b) + std::min(c, d) - wide - 0.01F,
              base + std::max(a, b) + std::max(c, d) + wide + 1.01F, low, high);
      if (low >= high) continue;
      const Floats down = LANES_F + (float(v) - e.v1);
      const Floats q = larger(Floats{}, down * per_head), rest = 1.0F - q;
      const Floats w = larger(Floats{} + slant, e.ear * (0.4F + 2.4F * q * rest));
      const Floats at = base + du * down + e.nod * rest * rest;
      const Ints plain = ((LANES + (v + ears)) & 3) == 0;
      paint(p, v, n, at - w, at + w, e.z1 + dz * down,
            plain ? Words{} + place : Words{} + (place + 1), low, high);
    }
  }
  const float stem = std::max(e.stem, slant), top = e.ear_share * lengthwise;
  const float to_shade = float(SHADES) / ((e.visible - e.ear_share) * lengthwise);
  for (int v = std::max(va, vh); v <= vb; v += WIDTH) {
    const int n = std::min(WIDTH, vb + 1 - v);
    const float first = float(v) - e.v1;
    const float a = base + du * (first + 0.5F), b = base + du * (first + (float(n) - 0.5F));
    columns(std::min(a, b) - stem, std::max(std::max(a, b) + stem, std::max(a, b) - stem + 1.0F),
            low, high);
    if (low >= high) continue;
    const Floats down = LANES_F + first;
    const Floats at = base + du * down;
    const Ints shade = __builtin_convertvector((down - top) * to_shade, Ints);
    const Words with =
        (Words)(shade < SHADES ? (shade > 0 ? shade : Ints{}) : Ints{} + (SHADES - 1));
    paint(p, v, n, at - stem, at + stem, e.z1 + dz * down, with + (place + 2), low, high);
  }
}

// A trunk's bark, a house's roof, or its wall with windows, packed as a tile's texel.
int32_t masonry(int kind, int hit, float x, float y, float z) {
  if (kind == TRUNK) return 38 | 52 << 8 | 66 << 16;
  if (hit == CANOPY) return 70 | 84 << 8 | 150 << 16;
  const float along = 0.6F * (x + y);
  if (along - std::floor(along) < 0.3F && z > 0.9F && z < 1.9F) return 62 | 66 << 8 | 70 << 16;
  return 160 | 186 << 8 | 198 << 16;
}

// atan to 1e-5: a series, so that several run at once.
inline float azimuth(float tangent) {
  const bool steep = std::abs(tangent) > 1.0F;
  const float x = steep ? 1.0F / tangent : tangent, q = x * x;
  float series = 0.05265332F - 0.0117212F * q;
  series = 0.19354346F + q * (series * q - 0.11643287F);
  const float angle = x * (0.99997726F + q * (series * q - 0.33262347F));
  const float right = tangent > 0.0F ? PI / 2 : -PI / 2;
  return steep ? right - angle : angle;
}

// The bits of n apart, with a gap after each: the Z-order of sim_plant/texture.py.
inline int32_t spread(int32_t n) {
  n = (n | n << 8) & 0x00FF00FF;
  n = (n | n << 4) & 0x0F0F0F0F;
  n = (n | n << 2) & 0x33333333;
  return (n | n << 1) & 0x55555555;
}

// The pixels of two columns and two rows meet the same: squares, by the first row of each, that
// wait for the same kind of paint, filled up to whole batches.
struct Waiting {
  int n = 0;
  int32_t row[ROOM / 2];

  // With the last batch's first square.
  void fill_up() {
    const int first = n % BATCH > 0 ? row[n - n % BATCH] : 0;
    for (int k = n; k < n + BATCH; ++k) row[k] = first;
  }
};

// Whether a batch's squares lie each below the other. One filled up ends where it begins.
inline bool in_a_row(const int32_t *row) { return row[BATCH - 1] - row[0] == 2 * (BATCH - 1); }

// A batch of squares whose texels are on their way from memory: a pixel's colour is its texel's
// times the square's `gain` plus `fog`.
struct Coming {
  int32_t texel[4][BATCH], masonry[BATCH], label[BATCH];
  float gain[3][BATCH], fog[BATCH];
};

// Two columns of pixels; the same one twice at the picture's right border.
struct Pair {
  const Picture &p;
  const Heading &h;
  const Light &light;
  const Rays rays[2];
  const float *depth[2];
  uint32_t *colour[2];
};

// A pixel that waits takes its colour.
inline void take(uint32_t &pixel, uint32_t colour) { pixel = pixel >> 24 >= SKY ? colour : pixel; }

void fill_sky(const Pair &pair, const int32_t *row) {
  const Picture &p = pair.p;
  const Heading &h = pair.h;
  const float last = float(p.panorama_rows - 1);
  const float per_row = float(p.panorama_rows) / (PANORAMA_TOP - PANORAMA_BOTTOM);
  const float per_column = float(p.panorama_columns) / (2.0F * PI);
  const int32_t around = int32_t(p.panorama_columns);
  // A turn more than the panorama's beginning, so that no column is negative.
  const float ahead = h.azimuth + 3.0F * PI;
  for (int c = 0; c < 2; ++c) {
    const Rays rays = pair.rays[c];
    // Two rows lie at the same azimuth.
    int32_t at[2][BATCH];
    for (int k = 0; k < BATCH; ++k) {
      float a, b;
      rays.at(row[k], a, b);
      const float per = 1.0F / std::max(1e-7F, a * h.ra + b * h.da + h.fa);
      const float lateral = (a * h.rl + b * h.dl) * per;
      const float per_flat = per / std::sqrt(1.0F + lateral * lateral);
      int32_t i = int32_t((ahead + azimuth(lateral)) * per_column);
      i = i >= around ? i - around : i;
      i = i >= around ? i - around : i;
      const float steep = (a * h.rz + b * h.dz + h.fz) * per_flat;
      at[0][k] = int32_t(limited((PANORAMA_TOP - steep) * per_row, 0.0F, last)) * around + i;
      rays.at(row[k] + 1, a, b);
      const float under = (a * h.rz + b * h.dz + h.fz) * per_flat;
      at[1][k] = int32_t(limited((PANORAMA_TOP - under) * per_row, 0.0F, last)) * around + i;
    }
    for (int down = 0; down < 2; ++down)
      for (int k = 0; k < BATCH; ++k)
        take(pair.colour[c][row[k] + down],
             uint32_t(L_BACKGROUND) << 24 | uint32_t(p.panorama[at[down][k]]));
  }
}

// What lies below the horizon: where rays end on the ground, on the crop's canopy or face, or on
// masonry. Each square has one light, that of its middle; each pixel its own texel.
template <int hit>
void light_land(const Pair &pair, const int32_t *row, Coming &out) {
  constexpr bool ground = hit == GROUND, top = hit == CANOPY;
  const Picture &p = pair.p;
  // A copy, which nothing that is written here can change.
  const Light light = pair.light;
  float R[9];
  for (int q = 0; q < 9; ++q) R[q] = float(p.axes[q]);
  const float inv = float(0.5 / p.cell);
  const float cell_x = float((p.x - p.x0) * 0.5 / p.cell),
              cell_y = float((p.y - p.y0) * 0.5 / p.cell);
  const float x0 = float(p.x), y0 = float(p.y), z0 = float(p.z);
  const int n_i = int(p.coarse_columns), n_j = int(p.coarse_rows);
  const float last_i = float(n_i - 1), last_j = float(n_j - 1);
  const float per_footprint = 1.0F / (float(p.focal) * TEXEL_M) / 1.4F;
  const float haze = float(p.haze), per_slab = 1.0F / float(p.canopy);
  float px[4][BATCH], py[4][BATCH], pz[4][BATCH], pt[4][BATCH];
  float xs[BATCH], ys[BATCH], zs[BATCH], ts[BATCH], seen[BATCH], ao[BATCH], unripe[BATCH],
      foot[BATCH];
  int32_t marks[BATCH], looks[BATCH], kinds[BATCH], tiles[BATCH], here[BATCH], outside[BATCH],
      flat[BATCH];
  float depth[4][BATCH];
  for (int c = 0; c < 2; ++c) {
    const float *in = pair.depth[c];
    if (in_a_row(row)) {
      in += row[0];
      for (int k = 0; k < BATCH; ++k) depth[c][k] = in[2 * k], depth[c + 2][k] = in[2 * k + 1];
    } else {
      for (int k = 0; k < BATCH; ++k) depth[c][k] = in[row[k]], depth[c + 2][k] = in[row[k] + 1];
    }
  }
  for (int q = 0; q < 4; ++q) {
    for (int k = 0; k < BATCH; ++k) {
      float a, b;
      pair.rays[q & 1].at(row[k] + (q >> 1), a, b);
      const float east = a * R[0] + b * R[3] + R[6];
      const float north = a * R[1] + b * R[4] + R[7];
      const float up = a * R[2] + b * R[5] + R[8];
      float t = depth[q][k];
      if (!ground)
        t -= (top ? CANOPY_BACK_M : FACE_BACK_M - 0.01F) / std::sqrt(east * east + north * north);
      pt[q][k] = t;
      px[q][k] = t * east;
      py[q][k] = t * north;
      pz[q][k] = t * up;
    }
  }
  for (int k = 0; k < BATCH; ++k) {
    const float x = 0.5F * (px[0][k] + px[3][k]), y = 0.5F * (py[0][k] + py[3][k]);
    const float t = 0.5F * (pt[0][k] + pt[3][k]), z = 0.5F * (pz[0][k] + pz[3][k]);
    ts[k] = t;
    xs[k] = x0 + x;
    ys[k] = y0 + y;
    zs[k] = z0 + z;
    const float ci = cell_x + x * inv, cj = cell_y + y * inv;
    outside[k] = int(ci < 0.0F) | int(cj < 0.0F) | int(ci >= float(n_i)) | int(cj >= float(n_j));
    const float qx = limited(ci, 0.0F, last_i), qy = limited(cj, 0.0F, last_j);
    const int32_t at = int(qy) * n_i + int(qx);
    const int quarter = 2 * (int(qy * 2.0F) & 1) + (int(qx * 2.0F) & 1);
    int32_t mark;
    if (ground) {
      // How high shadows reach, between the middles of four cells, of which this is one.
      const float rx = limited(ci - 0.5F, 0.0F, last_i - 0.001F),
                  ry = limited(cj - 0.5F, 0.0F, last_j - 0.001F);
      const int i = int(rx), j = int(ry), corner = j * n_i + i;
      const float fx = rx - float(i), fy = ry - float(j);
      const int32_t m0 = p.land[corner].marks, m1 = p.land[corner + 1].marks;
      const int32_t m2 = p.land[corner + n_i].marks, m3 = p.land[corner + n_i + 1].marks;
      const float a = float(m0 & 0xFFFF), b = float(m1 & 0xFFFF);
      const float c = float(m2 & 0xFFFF), d = float(m3 & 0xFFFF);
      const float shadow = ((a + (b - a) * fx) * (1.0F - fy) + (c + (d - c) * fx) * fy) * UNIT;
      seen[k] = 1.0F - 0.88F * std::min(1.0F, shadow * 8.0F);
      mark = m0;
      mark = at == corner + 1 ? m1 : mark;
      mark = at == corner + n_i ? m2 : mark;
      mark = at == corner + n_i + 1 ? m3 : mark;
    } else {
      mark = p.land[at].marks;
    }
    marks[k] = mark & 0xFFFF;
    looks[k] = p.land[at].looks;
    kinds[k] = mark >> (16 + 4 * quarter) & 15;
    flat[k] = ground ? 0 : int(kinds[k] >= OBSTACLE);
    ao[k] = 0.8F + 0.4F * UNIT * float(looks[k] & 0xFFFF);
    // The footprint in texels.
    const float slope = ground || top ? 0.3F + 0.7F * std::min(1.0F, std::abs(z / t) * 2.0F) : 1.0F;
    foot[k] = t * per_footprint / slope;
  }
  if (ground) {
    for (int k = 0; k < BATCH; ++k) {
      unripe[k] = 0.0F;
      const int kind = kinds[k];
      const bool stubble = (kind == STUBBLE) | (kind == NEIGHBOUR_STUBBLE);
      int tile = stubble ? int(T_STUBBLE) : int(T_SOIL),
          label = stubble ? int(L_STUBBLE) : int(L_SOIL);
      tile = kind == WINDROW ? int(T_STRAW) : tile;
      label = kind == WINDROW ? int(L_STRAW) : label;
      tiles[k] = kind == GRASS ? int(T_GRASS) : tile;
      here[k] = kind == GRASS ? int(L_WEEDS) : label;
    }
  } else {
    for (int k = 0; k < BATCH; ++k) {
      const float above = zs[k] - UNIT * float(marks[k]), t = ts[k];
      unripe[k] = UNIT * float(looks[k] >> 16 & 0xFFFF);
      const float far_lit = std::min(0.9F, 0.25F + 0.035F * t);
      const float top_lit = std::max(far_lit, std::min(1.0F, above * 4.0F + 0.3F));
      const float face_lit = limited(above * 3.0F + 0.5F, 0.12F, 0.9F);
      seen[k] = top ? top_lit : face_lit;
      ao[k] *= std::min(1.0F, top ? 0.85F + 0.01F * t : 0.6F + 0.4F * zs[k] * per_slab);
      tiles[k] = top ? int(T_TOP) : int(T_WALL);
      here[k] = kinds[k] == CROP ? int(L_STANDING) : int(L_NEIGHBOUR);
    }
  }
  int32_t odd = 0;
  for (int k = 0; k < BATCH; ++k) odd |= outside[k] | flat[k];
  if (odd) {
    for (int k = 0; k < BATCH; ++k) {
      if (outside[k]) {
        // Fields beyond the grid: blocks of some 40 m, ripe or grass.
        const int far_x = int(std::floor(xs[k] * 0.025F)), far_y = int(std::floor(ys[k] * 0.04F));
        const bool grass = ground && (mix(77, uint32_t(far_x), uint32_t(far_y)) & 3) == 0;
        tiles[k] = grass ? int(T_GRASS) : int(T_TOP);
        here[k] = ground ? int(L_BACKGROUND) : int(L_NEIGHBOUR);
        seen[k] = 0.85F;
        ao[k] = 1.0F;
        unripe[k] = 0.0F;
        flat[k] = 0;
      } else if (flat[k]) {
        here[k] = L_BACKGROUND;
        seen[k] = (zs[k] - UNIT * float(marks[k])) * 3.0F + 0.3F;
        ao[k] = 0.8F + 0.4F * UNIT * float(looks[k] & 0xFFFF);
        unripe[k] = 0.0F;
      }
    }
  }
  int32_t begin[BATCH], mask[BATCH];
  float scale[BATCH], stretch[BATCH];
  for (int k = 0; k < BATCH; ++k) {
    // How many halvings bring the footprint to 1.4 texels or less.
    const int32_t level = limited<int32_t>(((bits_of(foot[k]) - 1) >> 23) - 126, 0, LEVELS - 1);
    scale[k] = from_bits((127 - level) << 23) * (1.0F / TEXEL_M);
    stretch[k] = ts[k] < 2.0F ? 3.0F : 1.0F;
    const int32_t side = SIDE >> level;
    mask[k] = side - 1;
    // Larger levels come before: a third of the squares' difference, times 4.
    const int32_t before = 4 * int32_t(float(SIDE * SIDE - side * side) * (1.0F / 3.0F) + 0.5F);
    begin[k] = tiles[k] * int32_t(p.tile_size) + before;
  }
  for (int q = 0; q < 4; ++q) {
    for (int k = 0; k < BATCH; ++k) {
      const bool wall = tiles[k] == T_WALL;
      const float x = x0 + px[q][k], y = y0 + py[q][k], z = z0 + pz[q][k];
      const float along = wall ? (x * 0.83F + y * 0.57F) * 1.5F * stretch[k] : x;
      const float across = wall ? -z * stretch[k] : y;
      // The offset, a multiple of every tile's side, makes truncation a floor.
      const int32_t ti = int32_t(along * scale[k] + 65536.0F) & mask[k];
      const int32_t tj = int32_t(across * scale[k] + 65536.0F) & mask[k];
      out.texel[q][k] = begin[k] + spread(ti) + 2 * spread(tj);
    }
    for (int k = 0; k < BATCH; ++k) __builtin_prefetch(p.tiles + out.texel[q][k]);
  }
  for (int k = 0; k < BATCH; ++k) out.masonry[k] = -1;
  if (odd)
    for (int k = 0; k < BATCH; ++k)
      if (flat[k]) out.masonry[k] = masonry(kinds[k], hit, xs[k], ys[k], zs[k]);
  const float lb = float(p.unripe_loss[0]), lg = float(p.unripe_loss[1]),
              lr = float(p.unripe_loss[2]);
  for (int k = 0; k < BATCH; ++k) {
    const float sun = limited(seen[k], 0.0F, 1.0F);
    const float thick = haze * ts[k], fog = thick / (1.0F + thick), bright = ao[k] * (1.0F - fog);
    out.gain[0][k] = bright * light.on(0, sun) * (1.0F - unripe[k] * lb);
    out.gain[1][k] = bright * light.on(1, sun) * (1.0F - unripe[k] * lg);
    out.gain[2][k] = bright * light.on(2, sun) * (1.0F - unripe[k] * lr);
    out.fog[k] = fog;
    out.label[k] = here[k] << 24;
  }
}

void paint_land(const Pair &pair, const int32_t *row, const Coming &in) {
  const Picture &p = pair.p;
  const float hb = float(p.haze_bgr[0]), hg = float(p.haze_bgr[1]), hr = float(p.haze_bgr[2]);
  int32_t texels[4][BATCH];
  for (int q = 0; q < 4; ++q) {
    for (int k = 0; k < BATCH; ++k) texels[q][k] = p.tiles[in.texel[q][k]];
    for (int k = 0; k < BATCH; ++k) {
      const int32_t texel = in.masonry[k] >= 0 ? in.masonry[k] : texels[q][k];
      const float fog = in.fog[k];
      const float b = float(texel & 255) * in.gain[0][k] + fog * hb;
      const float g = float(texel >> 8 & 255) * in.gain[1][k] + fog * hg;
      const float r = float(texel >> 16) * in.gain[2][k] + fog * hr;
      texels[q][k] = int32_t(packed(b, g, r)) | in.label[k];
    }
  }
  for (int c = 0; c < 2; ++c) {
    uint32_t *colour = pair.colour[c];
    if (in_a_row(row)) {
      colour += row[0];
      uint32_t fresh[2 * BATCH];
      for (int k = 0; k < BATCH; ++k) {
        fresh[2 * k] = uint32_t(texels[c][k]);
        fresh[2 * k + 1] = uint32_t(texels[c + 2][k]);
      }
      for (int k = 0; k < 2 * BATCH; ++k) take(colour[k], fresh[k]);
    } else {
      for (int k = 0; k < BATCH; ++k) {
        take(colour[row[k]], uint32_t(texels[c][k]));
        take(colour[row[k] + 1], uint32_t(texels[c + 2][k]));
      }
    }
  }
}

// Gives the pixels of two columns their colours: a stalk's from the palette; where no stalk hides
// what `find` met, by light and texel.
void fill(const Picture &p, const Heading &h, const Light &light, const uint32_t *palette,
          int64_t u) {
  const int rows = int(p.rows + 1) & ~1;
  const int64_t one = u * p.stride, two = std::min(u + 1, p.columns - 1) * p.stride;
  const Pair pair = {p,
                     h,
                     light,
                     {Rays(p, u), Rays(p, std::min(u + 1, p.columns - 1))},
                     {p.depth + one, p.depth + two},
                     {p.colour + one, p.colour + two}};
  const uint32_t *keys[2] = {p.key + one, p.key + two};
  for (int c = 0; c < 2; ++c) {
    const uint32_t *key = keys[c];
    uint32_t *colour = pair.colour[c];
    if (p.crown_count == 0) {
      for (int v0 = 0; v0 < rows; v0 += BATCH) {
        // Where no stalk stands nothing is looked up. Columns have room for whole batches.
        uint32_t least = ~0U;
        for (int v = v0; v < v0 + BATCH; ++v) least = std::min(least, key[v] & 0xFFFF);
        if (least >= PALETTE) {
          for (int v = v0; v < v0 + BATCH; ++v) colour[v] = key[v] << 24;
        } else {
          for (int v = v0; v < v0 + BATCH; ++v) colour[v] = palette[key[v] & 0xFFFF];
        }
      }
    } else {
      for (int v = 0; v < rows; ++v)
        colour[v] = (key[v] & 0xFFFF) == PAINTED ? colour[v] : palette[key[v] & 0xFFFF];
    }
  }
  uint32_t met[ROOM / 2];
  for (int k = 0; k < rows / 2; ++k)
    met[k] = std::max(std::max(keys[0][2 * k] & 0xFFFF, keys[0][2 * k + 1] & 0xFFFF),
                      std::max(keys[1][2 * k] & 0xFFFF, keys[1][2 * k + 1] & 0xFFFF));
  Waiting sky, ground, canopy, face;
  for (int k = 0; k < rows / 2; ++k) {
    sky.row[sky.n] = ground.row[ground.n] = canopy.row[canopy.n] = face.row[face.n] = 2 * k;
    sky.n += met[k] == (MET | SKY);
    ground.n += met[k] == (MET | GROUND);
    canopy.n += met[k] == (MET | CANOPY);
    face.n += met[k] == (MET | FACE);
  }
  for (Waiting *list : {&sky, &ground, &canopy, &face}) list->fill_up();
  for (int k = 0; k < sky.n; k += BATCH) fill_sky(pair, sky.row + k);
  static thread_local Coming coming[ROOM / BATCH + 4];
  Coming *next = coming;
  for (int k = 0; k < ground.n; k += BATCH) light_land<GROUND>(pair, ground.row + k, *next++);
  for (int k = 0; k < canopy.n; k += BATCH) light_land<CANOPY>(pair, canopy.row + k, *next++);
  for (int k = 0; k < face.n; k += BATCH) light_land<FACE>(pair, face.row + k, *next++);
  next = coming;
  for (int k = 0; k < ground.n; k += BATCH) paint_land(pair, ground.row + k, *next++);
  for (int k = 0; k < canopy.n; k += BATCH) paint_land(pair, canopy.row + k, *next++);
  for (int k = 0; k < face.n; k += BATCH) paint_land(pair, face.row + k, *next++);
}

// The columns [left, right) of a part of the picture: pairs of columns meet the same.
struct Strip {
  int64_t part, left, right;

  Strip(const Picture &p, int64_t which) : part(which) {
    const int64_t pairs = (p.columns + 1) / 2;
    left = 2 * (pairs * part / p.parts);
    right = std::min(p.columns, 2 * (pairs * (part + 1) / p.parts));
  }
};

void find_all(const Picture &p, const Strip &strip) {
  const Heading h(p);
  for (int64_t u = strip.left; u < strip.right; u += 2)
    find(p, h, u, std::min<int64_t>(2, strip.right - u));
}

// Draws a strip's stalks and fills its palette.
void draw_stalks(const Picture &p, const Strip &strip, uint32_t *palette) {
  const int32_t *which = p.sorted + strip.part * PALETTE_STALKS;
  const int64_t last = p.dealt[strip.part] - 1;
  for (int64_t n = 0; n <= last; ++n) {
    // What comes next is on its way meanwhile.
    const char *soon = reinterpret_cast<const char *>(p.stalks + which[std::min(n + 6, last)]);
    __builtin_prefetch(soon);
    __builtin_prefetch(soon + 63);
    const Stalk &stalk = p.stalks[which[n]];
    const uint32_t place = uint32_t(n) * STALK_COLOURS;
    std::memcpy(palette + place, stalk.stripes, sizeof stalk.stripes);
    std::memcpy(palette + place + 2, stalk.stems, sizeof stalk.stems);
    draw_stalk(p, stalk, place, int(strip.left), int(strip.right));
  }
}

void fill_all(const Picture &p, const Strip &strip, const uint32_t *palette) {
  const Heading h(p);
  const Light light(p.light);
  for (int64_t u = strip.left; u < strip.right; u += 2) fill(p, h, light, palette, u);
}

// Columns [left, right) from where they are drawn into the picture, row by row.
void lay(const Picture &p, const Strip &strip) {
  const int64_t left = strip.left, right = strip.right, stride = p.stride;
  constexpr int64_t TALL = 16;
  for (int64_t v0 = 0; v0 < p.rows; v0 += TALL) {
    const int64_t v1 = std::min(p.rows, v0 + TALL);
    for (int64_t v = v0; v < v1; ++v) {
      uint8_t *out = p.image + (v * p.columns + left) * 3;
      const uint32_t *in = p.colour + left * stride + v;
      // The label goes where the next pixel comes, but for the last one.
      for (int64_t u = left; u < right - 1; ++u, out += 3, in += stride) std::memcpy(out, in, 4);
      std::memcpy(out, in, 3);
    }
  }
}

// Fills BODY and `Way::next` of the coarse cells [j0, j1) x [i0, i1): where a solid thing stands,
// or crop at least `narrowest` fine cells wide each way. `wide`: that many coarse cells further off
// matter.
void find_bodies(const Picture &p, int64_t j0, int64_t j1, int64_t i0, int64_t i1,
                 int64_t narrowest, int64_t wide) {
  const int64_t rows = 2 * p.coarse_rows, columns = 2 * p.coarse_columns;
  // All that the cells asked for depend on. Beyond the field's border its border goes on.
  const int64_t v0 = std::max<int64_t>(0, 2 * (j0 - wide)), v1 = std::min(rows, 2 * (j1 + wide));
  const int64_t u0 = std::max<int64_t>(0, 2 * (i0 - wide)), u1 = std::min(columns, 2 * (i1 + wide));
  const int64_t h = v1 - v0, w = u1 - u0, before = narrowest / 2, after = narrowest - 1 - before;
  if (h <= 0 || w <= 0) return;
  // From row to row; whole vectors.
  const int64_t stride = (w + 63) / 64 * 64;
  std::vector<uint8_t> one(size_t(h * stride)), two(size_t(h * stride));
  std::vector<uint8_t> line(size_t(stride + narrowest));
  for (int64_t v = 0; v < h; ++v) {
    const uint8_t *kind = p.kind + (v0 + v) * columns + u0;
    for (int64_t u = 0; u < w; ++u)
      one[size_t(v * stride + u)] = uint8_t(int(kind[u] == CROP) | int(kind[u] == NEIGHBOUR));
  }
  // The least of each neighbourhood, then the greatest of those.
  for (const bool least : {true, false}) {
    const auto gather = [&](uint8_t *out, const uint8_t *in) {
      for (int64_t u = 0; u < stride; ++u) {
        const uint8_t x = in[u], y = out[u];
        out[u] = least ? uint8_t(x & y) : uint8_t(x | y);
      }
    };
    for (int64_t v = 0; v < h; ++v) {
      const uint8_t *in = one.data() + v * stride;
      std::memset(line.data(), in[0], size_t(before));
      std::memcpy(line.data() + before, in, size_t(w));
      std::memset(line.data() + before + w, in[w - 1], size_t(after));
      uint8_t *out = two.data() + v * stride;
      std::memcpy(out, line.data(), size_t(stride));
      for (int64_t k = 1; k < narrowest; ++k) gather(out, line.data() + k);
    }
    for (int64_t v = 0; v < h; ++v) {
      uint8_t *out = one.data() + v * stride;
      std::memcpy(out, two.data() + std::max<int64_t>(0, v - before) * stride, size_t(stride));
      for (int64_t k = 1 - before; k <= after; ++k)
        gather(out, two.data() + limited<int64_t>(v + k, 0, h - 1) * stride);
    }
  }
  for (int64_t j = j0; j < j1; ++j) {
    for (int64_t i = i0; i < i1; ++i) {
      const uint8_t *kind = p.kind + 2 * j * columns + 2 * i;
      const uint8_t *crop = one.data() + (2 * j - v0) * stride + (2 * i - u0);
      const bool body = crop[0] || crop[1] || crop[stride] || crop[stride + 1] || solid(kind[0]) ||
                        solid(kind[1]) || solid(kind[columns]) || solid(kind[columns + 1]);
      const int64_t at = j * p.coarse_columns + i;
      uint16_t *cell = p.stand + at * CHANNELS;
      cell[BODY] = body;
      const int height = body ? cell[HEIGHT] : 0;
      p.way[at].next = uint16_t(height > 0 ? std::min(65535, BODY_FROM + height) : 0);
    }
  }
}

// Fills `Way::next` of the coarse cells [j0, j1) x [i0, i1) without a body: the squared distance to
// the nearest one, of which those more than `reach` cells away do not count.
void measure_clear(const Picture &p, int64_t j0, int64_t j1, int64_t i0, int64_t i1,
                   int64_t reach) {
  const int64_t w = i1 - i0, far = reach + 1;
  // From row to row; whole vectors.
  const int64_t stride = (w + 31) / 32 * 32;
  const int64_t top = std::max<int64_t>(0, j0 - reach),
                bottom = std::min(p.coarse_rows, j1 + reach);
  if (w <= 0 || bottom <= top) return;
  // Along each row first, squared.
  std::vector<uint16_t> along(size_t((bottom - top) * stride)), least(static_cast<size_t>(stride));
  for (int64_t j = top; j < bottom; ++j) {
    const Way *way = p.way + j * p.coarse_columns;
    uint16_t *out = along.data() + (j - top) * stride;
    int64_t away = far;
    for (int64_t i = std::max<int64_t>(0, i0 - reach); i < i1; ++i) {
      away = way[i].next >= BODY_FROM ? 0 : std::min(far, away + 1);
      if (i >= i0) out[i - i0] = uint16_t(away);
    }
    away = far;
    for (int64_t i = std::min(p.coarse_columns, i1 + reach) - 1; i >= i0; --i) {
      away = way[i].next >= BODY_FROM ? 0 : std::min(far, away + 1);
      if (i < i1) out[i - i0] = std::min(out[i - i0], uint16_t(away));
    }
    for (int64_t i = 0; i < stride; ++i) out[i] = uint16_t(out[i] * out[i]);
  }
  for (int64_t j = j0; j < j1; ++j) {
    std::fill(least.begin(), least.end(), uint16_t(2 * far * far));
    for (int64_t k = std::max(top, j - reach); k < std::min(bottom, j + reach + 1); ++k) {
      const uint16_t *in = along.data() + (k - top) * stride, down = uint16_t((k - j) * (k - j));
      for (int64_t i = 0; i < stride; ++i) least[i] = std::min(least[i], uint16_t(in[i] + down));
    }
    Way *out = p.way + j * p.coarse_columns + i0;
    for (int64_t i = 0; i < w; ++i)
      out[i].next =
          out[i].next >= BODY_FROM ? out[i].next : std::min(least[i], uint16_t(BODY_FROM - 1));
  }
}

// The blocks that stalks of a coarse cell belong to are looked up anew.
void forget(const Picture &p, int64_t j, int64_t i) {
  const double per_block = 2.0 * p.cell / BLOCK_M;
  const auto last = [&](int64_t k, int64_t blocks) {
    return std::min(int64_t(double(k + 1) * per_block), blocks - 1);
  };
  const int64_t b1 = last(j, p.block_rows), c1 = last(i, p.block_columns);
  for (int64_t b = int64_t(double(j) * per_block); b <= b1; ++b)
    for (int64_t c = int64_t(double(i) * per_block); c <= c1; ++c)
      p.known[b * p.block_columns + c] = 0;
}

// Fills SUNLIT in a range of coarse cells: how high the shadow of what stands sunward reaches.
void shade(const Picture &p, int64_t j0, int64_t j1, int64_t i0, int64_t i1) {
  const int64_t rows = p.coarse_rows, columns = p.coarse_columns;
  const double coarse = 2.0 * p.cell, east = p.sun[0], north = p.sun[1], up = p.sun[2];
  const double flat = std::max(std::sqrt(east * east + north * north), 1e-6);
  const float tangent = float(up / flat), highest_m = float(p.roof);
  const float dx = float(east / flat / coarse), dy = float(north / flat / coarse);
  for (int64_t j = j0; j < j1; ++j) {
    for (int64_t i = i0; i < i1; ++i) {
      float highest = 0.0F;
      for (int64_t k = 0; k < p.crown_count; ++k) {
        // Distance of the crown's centre from the ray towards the sun, in cells.
        const double *crown = p.crowns + 4 * k;
        const double cx = (crown[0] - p.x0) / coarse - double(i) - 0.5;
        const double cy = (crown[1] - p.y0) / coarse - double(j) - 0.5;
        const double cz = crown[2] / coarse, radius = crown[3] / coarse;
        const double along = cx * east + cy * north + cz * up;
        if (cx * cx + cy * cy + cz * cz - along * along < radius * radius)
          highest = std::max(highest, float(cz * coarse));
      }
      for (float s = 0.15F; s * tangent < highest_m; s += 0.05F) {
        const float x = float(i) + 0.5F + dx * s, y = float(j) + 0.5F + dy * s;
        if (!(x >= 0.0F && y >= 0.0F && x < float(columns) && y < float(rows))) break;
        const uint16_t *cell = p.stand + (int64_t(y) * columns + int64_t(x)) * CHANNELS;
        if (cell[BODY] > 0) highest = std::max(highest, UNIT * cell[HEIGHT] - s * tangent);
      }
      const uint16_t sunlit = uint16_t(std::min(65535.0F, highest / UNIT + 0.5F));
      uint16_t &before = p.stand[(j * columns + i) * CHANNELS + SUNLIT];
      if (sunlit != before) forget(p, j, i);
      before = sunlit;
    }
  }
}

}  // namespace

extern "C" {

// Lists the blocks of stalks within the view's wedge, near ones first, and how many stalks of each
// are shown: distant blocks show a prefix of their stalks, wider. Returns the number of blocks.
int64_t plan(Picture *picture) {
  Picture &p = *picture;
  const Heading h(p);
  const double half_fov = std::atan(p.corner) + 0.05, cosine = std::cos(half_fov),
               sine = std::sin(half_fov);
  const double east = p.x - p.x0, north = p.y - p.y0;
  const auto block = [](double m, int64_t most) {
    return std::min(most, int64_t(std::max(0.0, m / BLOCK_M)));
  };
  const int64_t i0 = block(east - REACH_M, p.block_columns),
                i1 = block(east + REACH_M + BLOCK_M, p.block_columns);
  const int64_t j0 = block(north - REACH_M, p.block_rows),
                j1 = block(north + REACH_M + BLOCK_M, p.block_rows);
  // The picture's border, a little wider.
  float a_low = 1e9F, a_high = -1e9F, b_low = 1e9F, b_high = -1e9F;
  const auto reach = [&](int64_t u, int64_t v) {
    float a, b;
    Rays(p, u).at(int(v), a, b);
    a_low = std::min(a_low, a - 0.02F);
    a_high = std::max(a_high, a + 0.02F);
    b_low = std::min(b_low, b - 0.02F);
    b_high = std::max(b_high, b + 0.02F);
  };
  for (int64_t u = 0; u < p.columns; u += 8) reach(u, 0), reach(u, p.rows - 1);
  for (int64_t v = 0; v < p.rows; v += 8) reach(0, v), reach(p.columns - 1, v);
  reach(p.columns - 1, p.rows - 1);
  // Whether a block with its middle at (x, y) from the camera has no stalk in the picture.
  const double half = 0.5 * BLOCK_M + 0.35 * p.tallest, top = 1.2 * p.tallest;
  const auto beside_picture = [&](double x, double y) {
    int sides = 15;
    for (int corner = 0; corner < 8; ++corner) {
      const double ax = x + (corner & 1 ? half : -half), ay = y + (corner & 2 ? half : -half);
      const double az = (corner & 4 ? top : 0.0) - p.z;
      const double z = p.axes[6] * ax + p.axes[7] * ay + p.axes[8] * az;
      if (z < 0.3) return false;
      const double a = (p.axes[0] * ax + p.axes[1] * ay + p.axes[2] * az) / z;
      const double b = (p.axes[3] * ax + p.axes[4] * ay + p.axes[5] * az) / z;
      sides &= int(a < a_low) | int(a > a_high) << 1 | int(b < b_low) << 2 | int(b > b_high) << 3;
    }
    return sides != 0;
  };
  // Sorted by distance in steps of 1/64 m, otherwise in the order of the grid.
  constexpr int STEPS = int(REACH_M) * 64 + 1;
  static thread_local int32_t found[(2 * 40 + 4) * (2 * 40 + 4)], step[(2 * 40 + 4) * (2 * 40 + 4)];
  int32_t start[STEPS + 1] = {};
  int64_t n = 0;
  for (int64_t j = j0; j < j1; ++j) {
    for (int64_t i = i0; i < i1; ++i) {
      const double ax = (double(i) + 0.5) * BLOCK_M - east,
                   ay = (double(j) + 0.5) * BLOCK_M - north;
      const double ahead = ax * h.hx + ay * h.hy, aside = std::abs(ax * h.hy - ay * h.hx);
      const double away = std::sqrt(ax * ax + ay * ay);
      if (away > REACH_M || ahead < -0.4 || aside * cosine - ahead * sine > 0.6) continue;
      if (away > 1.5 && beside_picture(ax, ay)) continue;
      found[n] = int32_t(j * p.block_columns + i);
      step[n] = int32_t(away * 64.0);
      ++start[step[n] + 1];
      ++n;
    }
  }
  for (int s = 0; s < STEPS; ++s) start[s + 1] += start[s];
  for (int64_t k = 0; k < n; ++k) {
    const int32_t to = start[step[k]]++;
    p.blocks[to] = found[k];
    // The size of its share for now.
    const double away = std::max(0.1, step[k] / 64.0);
    p.first[to + 1] =
        int64_t(std::ceil(double(p.pack_size) * limited(ALL_SHOWN_M / away, 0.05, 1.0)));
  }
  p.first[0] = 0;
  for (int64_t k = 0; k < n; ++k) p.first[k + 1] += p.first[k];
  p.block_count = n;
  // The azimuths in the picture lie between those of its border.
  const auto lateral = [&](int64_t u, int64_t v) {
    float a, b;
    Rays(p, u).at(int(v), a, b);
    return (a * h.rl + b * h.dl + h.fl) / std::max(1e-7F, a * h.ra + b * h.da + h.fa);
  };
  float low = 1e9F, high = -1e9F;
  const auto meet = [&](int64_t u, int64_t v) {
    const float x = lateral(u, v);
    low = std::min(low, x);
    high = std::max(high, x);
  };
  for (int64_t u = 0; u < p.columns; ++u) meet(u, 0), meet(u, p.rows - 1);
  for (int64_t v = 0; v < p.rows; ++v) meet(0, v), meet(p.columns - 1, v);
  const auto bin = [&](float x) {
    return int64_t(limited((double(x) + p.tangent) * 0.5 * double(p.bins) / p.tangent, 0.0,
                           double(p.bins - 1)));
  };
  p.bin_from = std::max<int64_t>(0, bin(low) - 1);
  p.bin_to = std::min(p.bins, bin(high) + 2);
  return p.first[n];
}

// The parts [from, to) of what `draw` needs: the stalks of some blocks, the profiles of some
// azimuths.
void prepare_part(const Picture &p, int64_t part) {
  const auto begin = [&](int64_t k) {
    const int64_t stalks = p.first[p.block_count] * k / p.parts;
    return k == p.parts ? p.block_count
                        : std::lower_bound(p.first, p.first + p.block_count, stalks) - p.first;
  };
  const int64_t k0 = begin(part), k1 = begin(part + 1);
  int64_t n = p.first[k0];
  p.drawn[2 * part] = n;
  for (int64_t k = k0; k < k1; ++k) {
    // The block after the next is on its way meanwhile.
    const int64_t soon = std::min(k + 2, p.block_count - 1);
    const float *grown = p.grown + size_t(p.blocks[soon]) * FIELDS * size_t(p.most);
    const int64_t shown = p.first[soon + 1] - p.first[soon];
    for (int64_t line = 0; line < (shown + BATCH - 1) / BATCH * FIELDS; ++line)
      __builtin_prefetch(grown + line * BATCH);
    n += project(p, k, p.stalks + n, p.spans + 2 * n);
  }
  p.drawn[2 * part + 1] = n;
  const Heading h(p);
  const int64_t batches = (p.bin_to - p.bin_from + WIDTH - 1) / WIDTH;
  const int64_t last = std::min(p.bin_to, p.bin_from + batches * (part + 1) / p.parts * WIDTH);
  for (int64_t b = p.bin_from + batches * part / p.parts * WIDTH; b < last; b += MARCHES * WIDTH)
    profile(p, h, b, std::min(b + MARCHES * WIDTH, last));
}

void prepare(const Picture *picture, int64_t from, int64_t to) {
  for (int64_t part = from; part < to; ++part) prepare_part(*picture, part);
}

// Deals the stalks out to the parts whose columns they cover, in their order: the nearest, as many
// as a part's palette holds.
void sort_stalks(const Picture *picture) {
  const Picture &p = *picture;
  int32_t part_of[ROOM];
  for (int64_t part = 0; part < p.parts; ++part) {
    const Strip strip(p, part);
    for (int64_t u = strip.left; u < strip.right; ++u) part_of[u] = int32_t(part);
    p.dealt[part] = 0;
  }
  for (int64_t part = 0; part < p.parts; ++part) {
    for (int64_t n = p.drawn[2 * part]; n < p.drawn[2 * part + 1]; ++n) {
      const int from = std::max<int>(p.spans[2 * n], 0),
                to = std::min<int>(p.spans[2 * n + 1], int(p.columns) - 1);
      if (from > to) continue;
      for (int64_t strip = part_of[from]; strip <= part_of[to]; ++strip)
        if (p.dealt[strip] < PALETTE_STALKS)
          p.sorted[strip * PALETTE_STALKS + p.dealt[strip]++] = int32_t(n);
    }
  }
}

// Columns of the parts [from, to) of a picture.
void draw_part(const Picture &whole, int64_t part) {
  const Strip strip(whole, part);
  // A strip's pixels stay in the nearer caches: each takes the place of the one before.
  static thread_local std::vector<float> depth;
  static thread_local std::vector<uint32_t> key, colour;
  const size_t pixels = size_t((strip.right - strip.left + AT_ONCE) * whole.stride);
  depth.resize(pixels);
  key.resize(pixels);
  colour.resize(pixels);
  Picture p = whole;
  p.depth = depth.data() - strip.left * p.stride;
  p.key = key.data() - strip.left * p.stride;
  p.colour = colour.data() - strip.left * p.stride;
  find_all(p, strip);
  draw_crowns(p, strip.left, strip.right);
  static thread_local uint32_t palette[1 << 16];
  for (uint32_t met : {SKY, CANOPY, FACE, GROUND}) palette[MET | met] = met << 24;
  draw_stalks(p, strip, palette);
  fill_all(p, strip, palette);
  lay(p, strip);
  for (int64_t u = strip.left; whole.labels && u < strip.right; ++u)
    for (int64_t v = 0; v < p.rows; ++v)
      whole.labels[v * p.columns + u] = uint8_t(p.colour[u * p.stride + v] >> 24);
}

void draw(const Picture *picture, int64_t from, int64_t to) {
  for (int64_t part = from; part < to; ++part) draw_part(*picture, part);
}

// The numbers that the plant's other code draws alike (sim_plant/noise.py): for a test.
double noise_smooth(int64_t seed, double x, double y) { return smooth(int(seed), x, y); }

// What follows from `kind`, after it changed in the coarse cells [j0, j1) x [i0, i1). A strip of
// crop narrower than `narrowest` cells is a row of stalks without a body.
void refresh(Picture *picture, int64_t j0, int64_t j1, int64_t i0, int64_t i1, int64_t narrowest) {
  const Picture &p = *picture;
  const double coarse = 2.0 * p.cell;
  const auto row = [&](int64_t j) { return limited<int64_t>(j, 0, p.coarse_rows); };
  const auto column = [&](int64_t i) { return limited<int64_t>(i, 0, p.coarse_columns); };
  // How far a change reaches in this way.
  const int64_t wide = (narrowest + 1) / 2;
  for (int64_t j = j0; j < j1; ++j)
    for (int64_t i = i0; i < i1; ++i) forget(p, j, i);
  j0 = row(j0 - wide), j1 = row(j1 + wide), i0 = column(i0 - wide), i1 = column(i1 + wide);
  find_bodies(p, j0, j1, i0, i1, narrowest, wide);
  const int64_t reach = int64_t(CAP_M / coarse + DIAGONAL);
  measure_clear(p, row(j0 - reach), row(j1 + reach), column(i0 - reach), column(i1 + reach), reach);
  // Shadows fall away from the sun, those of crop, which alone is ever cut, no further than this.
  const double flat = std::max(std::sqrt(p.sun[0] * p.sun[0] + p.sun[1] * p.sun[1]), 1e-6);
  const double longest = p.tallest * flat / std::max(p.sun[2], 0.03) / coarse;
  const double east = longest * p.sun[0] / flat, north = longest * p.sun[1] / flat;
  i0 = column(i0 - 1 - int64_t(std::ceil(std::max(0.0, east))));
  i1 = column(i1 + 1 + int64_t(std::ceil(std::max(0.0, -east))));
  j0 = row(j0 - 1 - int64_t(std::ceil(std::max(0.0, north))));
  j1 = row(j1 + 1 + int64_t(std::ceil(std::max(0.0, -north))));
  shade(p, j0, j1, i0, i1);
  for (int64_t j = j0; j < j1; ++j) {
    for (int64_t i = i0; i < i1; ++i) {
      const int64_t at = j * p.coarse_columns + i;
      const uint8_t *upper = p.kind + 4 * j * p.coarse_columns + 2 * i,
                    *lower = upper + 2 * p.coarse_columns;
      const uint32_t kinds =
          upper[0] | uint32_t(upper[1]) << 4 | uint32_t(lower[0]) << 8 | uint32_t(lower[1]) << 12;
      p.way[at].kinds = uint16_t(kinds);
      p.land[at].marks = int32_t(uint32_t(p.stand[at * CHANNELS + SUNLIT]) | kinds << 16);
    }
  }
}

// Lays the blade's dust over a picture (rows, columns, 3) in place. A puff is born along the
// blade's line every life/PUFFS seconds, rises, grows, drifts by `drift` (m/s in the vehicle frame)
// and fades. `mount` (4, 3): right, down, forward of the camera in the vehicle frame, and its
// place. `veil` (rows / VEIL, columns / VEIL): room for the opacity; `clouds`, 256 larger each
// way: noise.
void raise_dust(uint8_t *image, int64_t rows, int64_t columns, float *veil, const double *mount,
                double focal, int64_t seed, double t, double drift_x, double drift_y, double ahead,
                double half_width, double density, const float *clouds, const double *bgr) {
  constexpr int PUFFS = 14, OFFSETS = 256;
  constexpr double LIFE_S = 1.6, EVERY_S = LIFE_S / PUFFS;
  const int h = int(rows / VEIL), w = int(columns / VEIL);
  std::memset(veil, 0, size_t(h) * size_t(w) * sizeof(float));
  int top = h, bottom = 0, left = w, right = 0;
  const double newest = std::floor(t / EVERY_S);
  for (int k = 0; k < PUFFS; ++k) {
    const int index = int(newest) - k;
    const double age = t - index * EVERY_S, share = age / LIFE_S;
    if (share >= 1.0) continue;
    const double px = ahead + drift_x * age - mount[9];
    const double py =
        (2.0 * uniform(int(seed), index, 1) - 1.0) * half_width + drift_y * age - mount[10];
    const double pz = 0.15 + (0.25 + 0.3 * uniform(int(seed), index, 2)) * age - mount[11];
    const double z = mount[6] * px + mount[7] * py + mount[8] * pz;
    if (z < 0.3) continue;
    const double u =
        focal * (mount[0] * px + mount[1] * py + mount[2] * pz) / z / double(VEIL) + 0.5 * w;
    const double v =
        focal * (mount[3] * px + mount[4] * py + mount[5] * pz) / z / double(VEIL) + 0.5 * h;
    const double radius = focal * (0.22 + 0.35 * age) / z / double(VEIL);
    const float strength =
        float(density * (1.0 - share) * (0.4 + 0.6 * uniform(int(seed), index, 3)));
    const int across = int(mix(uint32_t(seed), uint32_t(index), 4) % OFFSETS);
    const int down = int(mix(uint32_t(seed), uint32_t(index), 5) % OFFSETS);
    const float per_square = float(1.0 / (radius * radius)), uc = float(u), vc = float(v);
    const auto from = [](double x) { return int(limited(x, 0.0, 1e6)); };
    const auto until = [](double x, int most) { return int(limited(x + 1.0, 0.0, double(most))); };
    const int r0 = from(v - radius), r1 = until(v + radius, h), c0 = from(u - radius),
              c1 = until(u + radius, w);
    if (r0 >= r1 || c0 >= c1) continue;
    top = std::min(top, r0), bottom = std::max(bottom, r1);
    left = std::min(left, c0), right = std::max(right, c1);
    for (int j = r0; j < r1; ++j) {
      const float *cloud = clouds + size_t(down + j) * size_t(w + OFFSETS) + across;
      float *here = veil + size_t(j) * size_t(w);
      for (int i = c0; i < c1; ++i) {
        const float di = float(i) - uc, dj = float(j) - vc;
        const float inner = std::max(0.0F, 1.0F - (di * di + dj * dj) * per_square);
        const float opacity = std::min(1.0F, strength * inner * inner * (0.7F + 0.6F * cloud[i]));
        here[i] += (1.0F - here[i]) * opacity;
      }
    }
  }
  if (top >= bottom) return;
  // Enlarged between the middles of the veil's pixels.
  const int v0 = std::max(0, (top - 1) * VEIL), v1 = std::min(int(rows), (bottom + 1) * VEIL);
  // Whole vectors: where no dust is nothing changes.
  constexpr int WHOLE = 64;
  const int k0 = std::max(0, 3 * (left - 1) * VEIL) / WHOLE * WHOLE;
  const int k1 = std::min(3 * int(columns), (3 * (right + 1) * VEIL / WHOLE + 1) * WHOLE);
  float column[ROOM];
  int16_t share[ROOM + VEIL], line[3 * ROOM], dust[3 * ROOM];
  for (int k = 0; k < 3 * int(columns); ++k) dust[k] = int16_t(bgr[k % 3]);
  for (int v = v0; v < v1; ++v) {
    const float y = limited((float(v) + 0.5F) / VEIL - 0.5F, 0.0F, float(h - 1));
    const int j = std::min(int(y), h - 2);
    const float fy = y - float(j);
    const float *one = veil + size_t(j) * size_t(w);
    int32_t dusty = 0;
    for (int i = 0; i < w; ++i) {
      column[i] = one[i] + (one[i + w] - one[i]) * fy;
      dusty |= int32_t(column[i] > 0.0F);
    }
    if (!dusty) continue;
    // In 256ths. Pixels come VEIL by VEIL between the middles of the veil's.
    column[w] = column[w - 1];
    for (int k = 0; k < VEIL / 2; ++k) share[k] = int16_t(256.0F * column[0]);
    for (int i = 0; i < w; ++i)
      for (int k = 0; k < VEIL; ++k) {
        const float place = (float(k) + 0.5F) / VEIL;
        share[VEIL * i + VEIL / 2 + k] =
            int16_t(256.0F * (column[i] + (column[i + 1] - column[i]) * place));
      }
    for (int u = VEIL * w; u < int(columns); ++u) share[u] = share[VEIL * w - 1];
    for (int u = 0; u < int(columns); ++u)
      line[3 * u] = line[3 * u + 1] = line[3 * u + 2] = share[u];
    uint8_t *out = image + (int64_t(v) * columns) * 3;
    for (int k = k0; k < k1; ++k) out[k] = uint8_t(out[k] + ((dust[k] - out[k]) * line[k] >> 8));
  }
}

// One row of a picture (rows, columns, 3) through the lens's blur: a binomial of 3 by 3 pixels. The
// picture goes on mirrored beyond its border, the border itself not repeated. `down`: room for n
// + 6.
inline void soften_row(const uint8_t *image, int64_t rows, int64_t n, int64_t v,
                       uint16_t *__restrict down, uint8_t *__restrict out) {
  const uint8_t *here = image + v * n;
  const uint8_t *above = image + (v > 0 ? v - 1 : std::min<int64_t>(1, rows - 1)) * n;
  const uint8_t *below = image + (v < rows - 1 ? v + 1 : std::max<int64_t>(0, rows - 2)) * n;
  uint16_t *sum = down + 3;
  for (int64_t k = 0; k < n; ++k) sum[k] = uint16_t(above[k] + 2 * here[k] + below[k]);
  for (int c = 0; c < 3; ++c) {
    sum[c - 3] = sum[c + 3];
    sum[n + c] = sum[n + c - 6];
  }
  for (int64_t k = 0; k < n; ++k)
    out[k] = uint8_t(uint16_t(sum[k - 3] + 2 * sum[k] + sum[k + 3] + 8) >> 4);
}

// The mean light of every eighth pixel of every eighth row, behind the lens's blur where that is
// not yet in the picture, and behind `vignette` (rows, columns).
double mean_light(const uint8_t *image, int64_t soft, const uint8_t *vignette, int64_t rows,
                  int64_t columns) {
  const int64_t n = 3 * columns;
  std::vector<uint16_t> down(size_t(n + 6));
  std::vector<uint8_t> row(static_cast<size_t>(n));
  int64_t sum = 0, count = 0;
  for (int64_t v = 0; v < rows; v += 8) {
    if (!soft) soften_row(image, rows, n, v, down.data(), row.data());
    const uint8_t *light = soft ? image + v * n : row.data();
    for (int64_t u = 0; u < columns; u += 8, count += 3)
      sum += (light[3 * u] + light[3 * u + 1] + light[3 * u + 2]) * vignette[v * columns + u];
  }
  return double(sum) / (255.0 * double(count));
}

// A row of the sensor's answer: gain by value, a shoulder above 200 counts that keeps highlights
// from clipping hard, and noise. In steps of 1/32 count; a gain of 1 is 32 / 255 * 65536.
inline void expose_row(const uint8_t *__restrict light, const uint8_t *__restrict vignette,
                       const uint16_t *__restrict gain, const int8_t *__restrict rough,
                       uint8_t *__restrict out, int64_t n) {
  constexpr int64_t RUN = 128;
  constexpr int STEPS = 32;
  uint16_t x[RUN];
  for (int64_t i0 = 0; i0 < n; i0 += RUN) {
    const int64_t m = std::min(RUN, n - i0);
    uint16_t loud = 0;
    for (int64_t k = 0; k < m; ++k) {
      const uint16_t product = uint16_t(light[i0 + k] * vignette[i0 + k]);
      x[k] = uint16_t((uint32_t(product) * gain[i0 + k]) >> 16);
      loud |= uint16_t(x[k] > 200 * STEPS);
    }
    if (loud) {
      for (int64_t k = 0; k < m; ++k) {
        const float y = float(x[k]) * (1.0F / STEPS);
        const float d = std::max(0.0F, y - 200.0F) * (1.0F / 55.0F);
        // The exponential's series.
        const float grown = 1.0F + d * (1.0F + d * (0.5F + d * (1.0F / 6.0F + d * (1.0F / 24.0F))));
        x[k] = uint16_t(int32_t((std::min(y, 200.0F) + 55.0F - 55.0F / grown) * STEPS));
      }
    }
    for (int64_t k = 0; k < m; ++k) {
      const int16_t y = int16_t(int16_t(x[k] + STEPS / 2) >> 5) + rough[i0 + k];
      out[i0 + k] = uint8_t(std::min<int16_t>(255, std::max<int16_t>(0, y)));
    }
  }
}

// The sensor's answer (rows, columns, 3) to light, `soft` or blurred here. `vignette` (rows,
// columns). `gain`: of blue, green and red. `rough` (rough_rows, columns + 128, 3): noise, of which
// each row of the picture takes a row and its beginning by chance, drawn with `draw`.
void expose(const uint8_t *light, int64_t soft, const uint8_t *vignette, const uint16_t *gain,
            const int8_t *rough, int64_t rough_rows, uint32_t draw, uint8_t *out, int64_t rows,
            int64_t columns) {
  constexpr uint32_t OFFSETS = 128;
  const int64_t n = 3 * columns, stride = 3 * (columns + OFFSETS);
  std::vector<uint16_t> down(size_t(n + 6)), gains(static_cast<size_t>(n));
  std::vector<uint8_t> row(static_cast<size_t>(n)), dark(static_cast<size_t>(n));
  for (int64_t k = 0; k < n; ++k) gains[size_t(k)] = gain[k % 3];
  for (int64_t v = 0; v < rows; ++v) {
    if (!soft) soften_row(light, rows, n, v, down.data(), row.data());
    const uint8_t *through = vignette + v * columns;
    uint8_t *each = dark.data();
    for (int64_t u = 0; u < columns; ++u)
      each[3 * u] = each[3 * u + 1] = each[3 * u + 2] = through[u];
    const uint32_t chance = mix(draw, uint32_t(v), 9);
    const int8_t *rough_row =
        rough + int64_t(chance % uint32_t(rough_rows)) * stride + 3 * ((chance >> 16) % OFFSETS);
    expose_row(soft ? light + v * n : row.data(), each, gains.data(), rough_row, out + v * n, n);
  }
}
}
