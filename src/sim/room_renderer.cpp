#include "autocal_vio/sim/room_renderer.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "autocal_vio/sim/random_source.h"

namespace autocal_vio {
namespace {

constexpr int kTextures = 3;
constexpr float kTexelsPerMetre = 160.0F;
constexpr double kLeastGain = 0.75;
constexpr int kSubsamples = 4;
constexpr float kSubsampleX[kSubsamples] = {-0.375F, 0.125F, 0.375F, -0.125F};
constexpr float kSubsampleY[kSubsamples] = {-0.125F, -0.375F, 0.125F, 0.375F};

// log2 in 1/256, linear between the powers of two (error below 0.09).
int coarseLog2(float x) {
  std::int32_t bits;
  std::memcpy(&bits, &x, sizeof(bits));
  return (bits >> 15) - (127 << 8);
}

float smaller(float a, float b) {
  return a < b ? a : b;
}
float larger(float a, float b) {
  return a > b ? a : b;
}

// Mip level in 1/256. The pixel's footprint on a surface has the area depth^2 area / |along|; oblique ones
// are smoothed a little more than that.
std::int32_t mipLevel(float depth, float area, float along) {
  const float texels = kTexelsPerMetre * kTexelsPerMetre * depth * depth * area;
  const std::int32_t level = (coarseLog2(texels) - coarseLog2(std::abs(along)) * 3 / 2) / 2;
  constexpr std::int32_t kHighest = 256 * (MipTexture::kLevels - 1);
  const std::int32_t positive = level > 0 ? level : 0;
  return positive < kHighest ? positive : kHighest;
}

}  // namespace

// What the rays of a tile hit.
struct RoomRenderer::Hits {
  float direction[3][kTilePixels];  // world
  float depth[kTilePixels];         // along the ray, in units of its length
  std::int32_t face[kTilePixels];
};

RoomRenderer::RoomRenderer(const Room& room, const CameraModel& camera, std::uint64_t seed)
    : room_(room),
      width_(camera.width()),
      height_(camera.height()),
      tile_columns_((width_ + kTileSize - 1) / kTileSize),
      tile_rows_((height_ + kTileSize - 1) / kTileSize) {
  if (static_cast<int>(room_.obstacles.size()) > Room::kMaxObstacles)
    room_.obstacles.resize(Room::kMaxObstacles);
  makeRays(camera);
  makeCones();
  makeFaces(seed);
  candidates_.resize(cones_.size());
  face_of_.assign(ray_x_.size(), 0);
  tile_face_.assign(cones_.size(), -1);
}

void RoomRenderer::makeRays(const CameraModel& camera) {
  const std::size_t pixels = static_cast<std::size_t>(tile_columns_) * tile_rows_ * kTilePixels;
  ray_x_.assign(pixels, 0.0F);
  ray_y_.assign(pixels, 0.0F);
  area_.assign(pixels, 1e-6F);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const std::optional<Eigen::Vector2d> normalized = camera.undistort(Eigen::Vector2d(x, y));
      Eigen::Vector2d pixel;
      Eigen::Matrix2d J;
      if (!normalized || !camera.distort(*normalized, &pixel, &J) || J.determinant() <= 0.0) {
        black_.emplace_back(x, y);
        continue;
      }
      ray_x_[index(x, y)] = static_cast<float>(normalized->x());
      ray_y_[index(x, y)] = static_cast<float>(normalized->y());
      area_[index(x, y)] = static_cast<float>(1.0 / J.determinant());
    }
  }
}

void RoomRenderer::makeCones() {
  for (int tile = 0; tile < tile_columns_ * tile_rows_; ++tile) {
    const int x0 = tile % tile_columns_ * kTileSize, y0 = tile / tile_columns_ * kTileSize;
    std::vector<Eigen::Vector3f> rays;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (int y = y0; y < std::min(height_, y0 + kTileSize); ++y) {
      for (int x = x0; x < std::min(width_, x0 + kTileSize); ++x) {
        rays.push_back(Eigen::Vector3f(ray_x_[index(x, y)], ray_y_[index(x, y)], 1.0F).normalized());
        sum += rays.back();
      }
    }
    Cone cone;
    cone.axis = sum.normalized();
    cone.cosine = 1.0F;
    for (const Eigen::Vector3f& ray : rays) cone.cosine = std::min(cone.cosine, cone.axis.dot(ray));
    cone.cosine = std::cos(std::acos(cone.cosine) + 0.003F);  // subsamples lie a little outside
    cone.sine = std::sqrt(1.0F - cone.cosine * cone.cosine);
    cones_.push_back(cone);
  }
}

void RoomRenderer::makeFaces(std::uint64_t seed) {
  for (int i = 0; i < kTextures; ++i) textures_.emplace_back(seed * kTextures + i);
  RandomSource random(seed, 41);
  constexpr float kSize = 1 << MipTexture::kSizeLog2;
  for (std::size_t i = 0; i < 6 * (1 + room_.obstacles.size()); ++i) {
    const int axis = static_cast<int>(i % 6) / 2;
    Face face{};
    face.texture = &textures_[static_cast<std::size_t>(random.uniform(0.0, kTextures - 1e-9))];
    face.axis = axis;
    face.axis_u = (axis + 1) % 3;
    face.axis_v = (axis + 2) % 3;
    if (random.chance(0.5)) std::swap(face.axis_u, face.axis_v);
    face.shift_u = static_cast<float>(random.uniform(0.0, kSize));
    face.shift_v = static_cast<float>(random.uniform(0.0, kSize));
    face.gain = static_cast<int>(256.0 * random.uniform(kLeastGain, 1.0));
    faces_.push_back(face);
  }
}

void RoomRenderer::prepare(const Transform& T_WC) {
  R_WC_ = T_WC.rotationMatrix().cast<float>();
  const Eigen::Vector3d& origin = T_WC.translation;
  const Transform T_CW = T_WC.inverse();
  slabs_.clear();
  spheres_.clear();
  for (int box = 0; box <= static_cast<int>(room_.obstacles.size()); ++box) {
    const Eigen::AlignedBox3d& bounds = box == 0 ? room_.walls : room_.obstacles[box - 1];
    Slab slab{};
    for (int i = 0; i < 3; ++i) {
      slab.low[i] = static_cast<float>(bounds.min()(i) - origin(i));
      slab.high[i] = static_cast<float>(bounds.max()(i) - origin(i));
    }
    slabs_.push_back(slab);
    if (box > 0) addSpheres(box, T_CW);
  }
  for (Face& face : faces_) {
    face.offset_u = 256.0F * (static_cast<float>(origin(face.axis_u)) * kTexelsPerMetre + face.shift_u);
    face.offset_v = 256.0F * (static_cast<float>(origin(face.axis_v)) * kTexelsPerMetre + face.shift_v);
  }
}

// Spheres in a row along the longest side fit closer than one around all.
void RoomRenderer::addSpheres(int box, const Transform& T_CW) {
  const Eigen::AlignedBox3d& bounds = room_.obstacles[box - 1];
  Eigen::Vector3d size = bounds.sizes();
  Eigen::Index longest;
  const double length = size.maxCoeff(&longest);
  size(longest) = 0.0;
  const int parts = std::max(1, static_cast<int>(std::ceil(length / std::max(0.1, size.maxCoeff()))));
  size(longest) = length / parts;
  for (int k = 0; k < parts; ++k) {
    Eigen::Vector3d center = bounds.center();
    center(longest) = bounds.min()(longest) + (k + 0.5) * size(longest);
    Sphere sphere;
    sphere.box = box;
    sphere.center = (T_CW * center).cast<float>();
    sphere.distance = sphere.center.norm();
    sphere.sine = std::min(1.0F, static_cast<float>(0.5 * size.norm()) / sphere.distance);
    sphere.cosine = std::sqrt(1.0F - sphere.sine * sphere.sine);
    sphere.everywhere = sphere.sine >= 1.0F;
    spheres_.push_back(sphere);
  }
}

void RoomRenderer::findCandidates(const Cone& cone, std::vector<int>* boxes) const {
  boxes->clear();
  for (const Sphere& sphere : spheres_) {
    if (!boxes->empty() && boxes->back() == sphere.box) continue;
    // Within the sum of both half angles; the sum stays below 180 degrees.
    const float bound = cone.cosine * sphere.cosine - cone.sine * sphere.sine;
    if (sphere.everywhere || cone.axis.dot(sphere.center) >= bound * sphere.distance)
      boxes->push_back(sphere.box);
  }
}

void RoomRenderer::cast(const float* ray_x, const float* ray_y, int count, const std::vector<int>& boxes,
                        Hits* hits) const {
  // Local arrays and plain conditional expressions: the compiler vectorises these loops.
  float inverse[3][kTilePixels];
  for (int k = 0; k < 3; ++k) {
    const float r0 = R_WC_(k, 0), r1 = R_WC_(k, 1), r2 = R_WC_(k, 2);
    float* direction = hits->direction[k];
    for (int i = 0; i < count; ++i) direction[i] = r0 * ray_x[i] + r1 * ray_y[i] + r2;
    for (int i = 0; i < count; ++i) inverse[k][i] = 1.0F / direction[i];
  }
  float* depth = hits->depth;
  std::int32_t* face = hits->face;
  const Slab walls = slabs_[0];
  for (int i = 0; i < count; ++i) {
    const float x = larger(walls.low[0] * inverse[0][i], walls.high[0] * inverse[0][i]);
    const float y = larger(walls.low[1] * inverse[1][i], walls.high[1] * inverse[1][i]);
    const float z = larger(walls.low[2] * inverse[2][i], walls.high[2] * inverse[2][i]);
    const float xy = smaller(x, y);
    // From inside, the planes ahead are seen.
    const int face_xy = x <= y ? 0 + (inverse[0][i] > 0.0F) : 2 + (inverse[1][i] > 0.0F);
    face[i] = xy <= z ? face_xy : 4 + (inverse[2][i] > 0.0F);
    depth[i] = smaller(xy, z);
  }
  for (const int box : boxes) {
    const Slab slab = slabs_[box];
    const int base = 6 * box;
    for (int i = 0; i < count; ++i) {
      const float x0 = slab.low[0] * inverse[0][i], x1 = slab.high[0] * inverse[0][i];
      const float y0 = slab.low[1] * inverse[1][i], y1 = slab.high[1] * inverse[1][i];
      const float z0 = slab.low[2] * inverse[2][i], z1 = slab.high[2] * inverse[2][i];
      const float x = smaller(x0, x1), y = smaller(y0, y1), z = smaller(z0, z1);
      const float xy = larger(x, y), entry = larger(xy, z);
      const float exit = smaller(smaller(larger(x0, x1), larger(y0, y1)), larger(z0, z1));
      const int face_xy = x >= y ? base + (inverse[0][i] < 0.0F) : base + 2 + (inverse[1][i] < 0.0F);
      const int face_xyz = xy >= z ? face_xy : base + 4 + (inverse[2][i] < 0.0F);
      // A hit where 0 < entry <= exit and nearer than the nearest so far.
      const float candidate = entry <= exit ? entry : depth[i];
      const float nearest = candidate > 0.0F ? smaller(candidate, depth[i]) : depth[i];
      face[i] = nearest < depth[i] ? face_xyz : face[i];
      depth[i] = nearest;
    }
  }
}

void RoomRenderer::shade(const Hits& hits, int begin, int end, const float* area, std::uint8_t* gray) const {
  std::int32_t u[kTileSize], v[kTileSize], level[kTileSize];
  while (begin < end) {
    // A run of pixels on one face: coordinates first, in a loop that is vectorised.
    int stop = begin + 1;
    while (stop < end && stop - begin < kTileSize && hits.face[stop] == hits.face[begin]) ++stop;
    const Face& face = faces_[hits.face[begin]];
    const float* along_u = hits.direction[face.axis_u] + begin;
    const float* along_v = hits.direction[face.axis_v] + begin;
    const float* along = hits.direction[face.axis] + begin;
    const float* depth = hits.depth + begin;
    const float offset_u = face.offset_u, offset_v = face.offset_v;
    const int count = stop - begin;
    for (int i = 0; i < count; ++i) {
      const float scale = 256.0F * kTexelsPerMetre * depth[i];
      u[i] = static_cast<std::int32_t>(offset_u + scale * along_u[i]);
      v[i] = static_cast<std::int32_t>(offset_v + scale * along_v[i]);
      level[i] = mipLevel(depth[i], area[i], along[i]);
    }
    const MipTexture& texture = *face.texture;
    for (int i = 0; i < count; ++i)
      gray[i] = static_cast<std::uint8_t>(texture.sample(u[i], v[i], level[i]) * face.gain >> 8);
    begin = stop;
    area += count;
    gray += count;
  }
}

void RoomRenderer::renderTile(int tile, cv::Mat* image) {
  const int x = tile % tile_columns_ * kTileSize, y = tile / tile_columns_ * kTileSize;
  const int columns = std::min(kTileSize, width_ - x), rows = std::min(kTileSize, height_ - y);
  const int first = tile * kTilePixels;
  findCandidates(cones_[tile], &candidates_[tile]);
  Hits hits;
  cast(&ray_x_[first], &ray_y_[first], kTilePixels, candidates_[tile], &hits);
  int different = 0;
  for (int i = 0; i < kTilePixels; ++i) {
    face_of_[first + i] = static_cast<std::uint8_t>(hits.face[i]);
    different |= hits.face[i] ^ hits.face[0];
  }
  tile_face_[tile] = different == 0 ? hits.face[0] : -1;
  for (int row = 0; row < rows; ++row) {
    const int begin = row * kTileSize;
    shade(hits, begin, begin + columns, &area_[first + begin], image->ptr<std::uint8_t>(y + row) + x);
  }
}

bool RoomRenderer::hasEdges(int tile) const {
  const int face = tile_face_[tile], column = tile % tile_columns_, row = tile / tile_columns_;
  return face < 0 || (column > 0 && tile_face_[tile - 1] != face) ||
         (column + 1 < tile_columns_ && tile_face_[tile + 1] != face) ||
         (row > 0 && tile_face_[tile - tile_columns_] != face) ||
         (row + 1 < tile_rows_ && tile_face_[tile + tile_columns_] != face);
}

void RoomRenderer::smoothEdges(int tile, cv::Mat* image) const {
  const int x0 = tile % tile_columns_ * kTileSize, y0 = tile / tile_columns_ * kTileSize;
  std::vector<cv::Point> pixels;
  for (int y = y0; y < std::min(height_, y0 + kTileSize); ++y) {
    for (int x = x0; x < std::min(width_, x0 + kTileSize); ++x) {
      const std::uint8_t face = face_of_[index(x, y)];
      const bool edge = (x > 0 && face_of_[index(x - 1, y)] != face) ||
                        (x + 1 < width_ && face_of_[index(x + 1, y)] != face) ||
                        (y > 0 && face_of_[index(x, y - 1)] != face) ||
                        (y + 1 < height_ && face_of_[index(x, y + 1)] != face);
      if (edge) pixels.emplace_back(x, y);
    }
  }
  smoothPixels(pixels, candidates_[tile], image);
}

void RoomRenderer::smoothPixels(const std::vector<cv::Point>& pixels, const std::vector<int>& boxes,
                                cv::Mat* image) const {
  constexpr int kBatch = kTilePixels / kSubsamples;
  float ray_x[kTilePixels], ray_y[kTilePixels], area[kTilePixels];
  std::uint8_t gray[kTilePixels];
  Hits hits;
  for (std::size_t begin = 0; begin < pixels.size(); begin += kBatch) {
    const int count = static_cast<int>(std::min<std::size_t>(kBatch, pixels.size() - begin));
    for (int k = 0; k < count; ++k) {
      const cv::Point p = pixels[begin + k];
      const int i = index(p.x, p.y);
      // Rays between pixels by linear interpolation.
      const int left = std::min(p.x, width_ - 2), top = std::min(p.y, height_ - 2);
      const int x0 = index(left, p.y), x1 = index(left + 1, p.y), y0 = index(p.x, top),
                y1 = index(p.x, top + 1);
      for (int s = 0; s < kSubsamples; ++s) {
        const int n = k * kSubsamples + s;
        ray_x[n] = ray_x_[i] + kSubsampleX[s] * (ray_x_[x1] - ray_x_[x0]) +
                   kSubsampleY[s] * (ray_x_[y1] - ray_x_[y0]);
        ray_y[n] = ray_y_[i] + kSubsampleX[s] * (ray_y_[x1] - ray_y_[x0]) +
                   kSubsampleY[s] * (ray_y_[y1] - ray_y_[y0]);
        area[n] = area_[i];
      }
    }
    cast(ray_x, ray_y, count * kSubsamples, boxes, &hits);
    shade(hits, 0, count * kSubsamples, area, gray);
    for (int k = 0; k < count; ++k) {
      int sum = kSubsamples / 2;
      for (int s = 0; s < kSubsamples; ++s) sum += gray[k * kSubsamples + s];
      image->at<std::uint8_t>(pixels[begin + k]) = static_cast<std::uint8_t>(sum / kSubsamples);
    }
  }
}

void RoomRenderer::render(const Transform& T_WC, cv::Mat* image) {
  image->create(height_, width_, CV_8UC1);
  prepare(T_WC);
  const int tiles = tile_columns_ * tile_rows_;
  for (int tile = 0; tile < tiles; ++tile) renderTile(tile, image);
  for (int tile = 0; tile < tiles; ++tile)
    if (hasEdges(tile)) smoothEdges(tile, image);
  for (const cv::Point& pixel : black_) image->at<std::uint8_t>(pixel) = 0;
}

}  // namespace autocal_vio
