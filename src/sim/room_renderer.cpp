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

// One coordinate of 16 rays (x, y, 1) turned by a rotation with this row.
void rotateRays(const Eigen::RowVector3f& row, const float* ray_x, const float* ray_y, float* rotated) {
  const float r0 = row(0), r1 = row(1), r2 = row(2);
  for (int i = 0; i < 16; ++i) rotated[i] = r0 * ray_x[i] + r1 * ray_y[i] + r2;
}

}  // namespace

// A row of rays and what they hit.
struct RoomRenderer::Span {
  float direction[3][kTileSize];  // world
  float depth[kTileSize];         // along the ray, in units of its length
  std::int32_t face[kTileSize];
};

RoomRenderer::RoomRenderer(const Room& room, const CameraModel& camera, std::uint64_t seed)
    : room_(room), width_(camera.width()), height_(camera.height()) {
  stride_ = (width_ + kTileSize - 1) / kTileSize * kTileSize;
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
  const std::size_t pixels = static_cast<std::size_t>(stride_) * tileRows() * kTileSize;
  ray_x_.assign(pixels, 0.0F);
  ray_y_.assign(pixels, 0.0F);
  area_.assign(pixels, 1e-6F);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const int i = y * stride_ + x;
      const std::optional<Eigen::Vector2d> normalized = camera.undistort(Eigen::Vector2d(x, y));
      Eigen::Vector2d pixel;
      Eigen::Matrix2d J;
      if (!normalized || !camera.distort(*normalized, &pixel, &J) || J.determinant() <= 0.0) {
        black_.push_back(i);
        continue;
      }
      ray_x_[i] = static_cast<float>(normalized->x());
      ray_y_[i] = static_cast<float>(normalized->y());
      area_[i] = static_cast<float>(1.0 / J.determinant());
    }
  }
}

void RoomRenderer::makeCones() {
  for (int row = 0; row < tileRows(); ++row) {
    for (int column = 0; column < tileColumns(); ++column) {
      std::vector<Eigen::Vector3f> rays;
      for (int y = row * kTileSize; y < std::min(height_, (row + 1) * kTileSize); ++y)
        for (int x = column * kTileSize; x < std::min(width_, (column + 1) * kTileSize); ++x)
          rays.push_back(
              Eigen::Vector3f(ray_x_[y * stride_ + x], ray_y_[y * stride_ + x], 1.0F).normalized());
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (const Eigen::Vector3f& ray : rays) sum += ray;
      Cone cone;
      cone.axis = sum.normalized();
      cone.cosine = 1.0F;
      for (const Eigen::Vector3f& ray : rays) cone.cosine = std::min(cone.cosine, cone.axis.dot(ray));
      cone.cosine = std::cos(std::acos(cone.cosine) + 0.003F);  // subsamples lie a little outside
      cone.sine = std::sqrt(1.0F - cone.cosine * cone.cosine);
      cones_.push_back(cone);
    }
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
    if (box == 0) continue;
    // Spheres in a row along the longest side fit closer than one around all.
    Eigen::Index longest;
    const double length = bounds.sizes().maxCoeff(&longest);
    Eigen::Vector3d size = bounds.sizes();
    size(longest) = 0.0;
    const int parts = std::max(1, static_cast<int>(std::ceil(length / std::max(0.1, size.maxCoeff()))));
    size(longest) = length / parts;
    for (int k = 0; k < parts; ++k) {
      Eigen::Vector3d center = bounds.center();
      center(longest) = bounds.min()(longest) + (k + 0.5) * size(longest);
      Sphere sphere;
      sphere.box = box;
      sphere.center = (T_WC.inverse() * center).cast<float>();
      sphere.distance = sphere.center.norm();
      sphere.sine = std::min(1.0F, static_cast<float>(0.5 * size.norm()) / sphere.distance);
      sphere.cosine = std::sqrt(1.0F - sphere.sine * sphere.sine);
      sphere.everywhere = sphere.sine >= 1.0F;
      spheres_.push_back(sphere);
    }
  }
  for (Face& face : faces_) {
    face.offset_u = 256.0F * (static_cast<float>(origin(face.axis_u)) * kTexelsPerMetre + face.shift_u);
    face.offset_v = 256.0F * (static_cast<float>(origin(face.axis_v)) * kTexelsPerMetre + face.shift_v);
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

void RoomRenderer::castSpan(const float* ray_x, const float* ray_y, const std::vector<int>& boxes,
                            Span* span) const {
  // Local copies and plain conditional expressions: the compiler vectorises these loops.
  float direction[3][kTileSize], inverse[3][kTileSize], depth[kTileSize];
  std::int32_t face[kTileSize];
  for (int k = 0; k < 3; ++k) {
    rotateRays(R_WC_.row(k), ray_x, ray_y, direction[k]);
    for (int i = 0; i < kTileSize; ++i) inverse[k][i] = 1.0F / direction[k][i];
  }
  const Slab walls = slabs_[0];
  for (int i = 0; i < kTileSize; ++i) {
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
    for (int i = 0; i < kTileSize; ++i) {
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
  std::memcpy(span->direction, direction, sizeof(direction));
  std::memcpy(span->depth, depth, sizeof(depth));
  std::memcpy(span->face, face, sizeof(face));
}

int RoomRenderer::shade(const Span& span, int i, float area) const {
  const Face& face = faces_[span.face[i]];
  const float depth = span.depth[i], scale = 256.0F * kTexelsPerMetre * depth;
  const int u = static_cast<int>(face.offset_u + scale * span.direction[face.axis_u][i]);
  const int v = static_cast<int>(face.offset_v + scale * span.direction[face.axis_v][i]);
  const int level = mipLevel(depth, area, span.direction[face.axis][i]);
  return face.texture->sample(u, v, level) * face.gain >> 8;
}

void RoomRenderer::shadeSpan(const Span& span, const float* area, int count, std::uint8_t* gray) const {
  int different = 0;
  for (int i = 1; i < kTileSize; ++i) different |= span.face[i] ^ span.face[0];
  if (different != 0) {
    for (int i = 0; i < count; ++i) gray[i] = static_cast<std::uint8_t>(shade(span, i, area[i]));
    return;
  }
  // The usual case, one face: coordinates first, in a loop that is vectorised.
  const Face& face = faces_[span.face[0]];
  const float* along_u = span.direction[face.axis_u];
  const float* along_v = span.direction[face.axis_v];
  const float* along = span.direction[face.axis];
  const float offset_u = face.offset_u, offset_v = face.offset_v;
  std::int32_t u[kTileSize], v[kTileSize], level[kTileSize];
  for (int i = 0; i < kTileSize; ++i) {
    const float scale = 256.0F * kTexelsPerMetre * span.depth[i];
    u[i] = static_cast<std::int32_t>(offset_u + scale * along_u[i]);
    v[i] = static_cast<std::int32_t>(offset_v + scale * along_v[i]);
    level[i] = mipLevel(span.depth[i], area[i], along[i]);
  }
  const MipTexture& texture = *face.texture;
  for (int i = 0; i < count; ++i)
    gray[i] = static_cast<std::uint8_t>(texture.sample(u[i], v[i], level[i]) * face.gain >> 8);
}

void RoomRenderer::renderTile(int tile, cv::Mat* image) {
  const int x = tile % tileColumns() * kTileSize, y = tile / tileColumns() * kTileSize;
  const int columns = std::min(kTileSize, width_ - x), rows = std::min(kTileSize, height_ - y);
  findCandidates(cones_[tile], &candidates_[tile]);
  Span span;
  int different = 0;
  for (int row = 0; row < rows; ++row) {
    const int first = (y + row) * stride_ + x;
    castSpan(&ray_x_[first], &ray_y_[first], candidates_[tile], &span);
    shadeSpan(span, &area_[first], columns, image->ptr<std::uint8_t>(y + row) + x);
    for (int i = 0; i < columns; ++i) {
      face_of_[first + i] = static_cast<std::uint8_t>(span.face[i]);
      different |= face_of_[first + i] ^ face_of_[y * stride_ + x];
    }
  }
  tile_face_[tile] = different == 0 ? face_of_[y * stride_ + x] : -1;
}

bool RoomRenderer::hasEdges(int tile) const {
  const int face = tile_face_[tile], column = tile % tileColumns(), row = tile / tileColumns();
  return face < 0 || (column > 0 && tile_face_[tile - 1] != face) ||
         (column + 1 < tileColumns() && tile_face_[tile + 1] != face) ||
         (row > 0 && tile_face_[tile - tileColumns()] != face) ||
         (row + 1 < tileRows() && tile_face_[tile + tileColumns()] != face);
}

void RoomRenderer::smoothEdges(int tile, cv::Mat* image) const {
  const int x0 = tile % tileColumns() * kTileSize, y0 = tile / tileColumns() * kTileSize;
  std::vector<int> pixels;
  for (int y = y0; y < std::min(height_, y0 + kTileSize); ++y) {
    for (int x = x0; x < std::min(width_, x0 + kTileSize); ++x) {
      const int i = y * stride_ + x;
      const std::uint8_t face = face_of_[i];
      const bool edge = (x > 0 && face_of_[i - 1] != face) || (x + 1 < width_ && face_of_[i + 1] != face) ||
                        (y > 0 && face_of_[i - stride_] != face) ||
                        (y + 1 < height_ && face_of_[i + stride_] != face);
      if (edge) pixels.push_back(i);
    }
  }
  smoothPixels(pixels, candidates_[tile], image);
}

void RoomRenderer::smoothPixels(const std::vector<int>& pixels, const std::vector<int>& boxes,
                                cv::Mat* image) const {
  constexpr int kPerSpan = kTileSize / kSubsamples;
  for (std::size_t begin = 0; begin < pixels.size(); begin += kPerSpan) {
    const int count = static_cast<int>(std::min<std::size_t>(kPerSpan, pixels.size() - begin));
    float ray_x[kTileSize] = {}, ray_y[kTileSize] = {};
    for (int k = 0; k < count; ++k) {
      const int i = pixels[begin + k], x = i % stride_, y = i / stride_;
      // Rays between pixels by linear interpolation.
      const int across = x + 1 < width_ ? i : i - 1, down = y + 1 < height_ ? i : i - stride_;
      for (int s = 0; s < kSubsamples; ++s) {
        ray_x[k * kSubsamples + s] = ray_x_[i] + kSubsampleX[s] * (ray_x_[across + 1] - ray_x_[across]) +
                                     kSubsampleY[s] * (ray_x_[down + stride_] - ray_x_[down]);
        ray_y[k * kSubsamples + s] = ray_y_[i] + kSubsampleX[s] * (ray_y_[across + 1] - ray_y_[across]) +
                                     kSubsampleY[s] * (ray_y_[down + stride_] - ray_y_[down]);
      }
    }
    Span span;
    castSpan(ray_x, ray_y, boxes, &span);
    for (int k = 0; k < count; ++k) {
      const int i = pixels[begin + k];
      int sum = kSubsamples / 2;
      for (int s = 0; s < kSubsamples; ++s) sum += shade(span, k * kSubsamples + s, area_[i]);
      image->at<std::uint8_t>(i / stride_, i % stride_) = static_cast<std::uint8_t>(sum / kSubsamples);
    }
  }
}

void RoomRenderer::render(const Transform& T_WC, cv::Mat* image) {
  image->create(height_, width_, CV_8UC1);
  prepare(T_WC);
  const int tiles = static_cast<int>(cones_.size());
  for (int tile = 0; tile < tiles; ++tile) renderTile(tile, image);
  for (int tile = 0; tile < tiles; ++tile)
    if (hasEdges(tile)) smoothEdges(tile, image);
  for (const int i : black_) image->at<std::uint8_t>(i / stride_, i % stride_) = 0;
}

}  // namespace autocal_vio
