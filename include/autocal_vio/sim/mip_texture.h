#pragma once

#include <cstdint>
#include <vector>

namespace autocal_vio {

/// A square gray texture that repeats in both directions, with its mip levels, sampled trilinearly.
class MipTexture {
 public:
  static constexpr int kSizeLog2 = 10;  ///< 1024 x 1024 texels
  static constexpr int kLevels = 8;
  static constexpr int kFractionBits = 8;

  /// "Dead leaves" of all sizes: rectangles and ellipses of random gray that cover each other, as natural
  /// images do; corners at every scale.
  explicit MipTexture(std::uint64_t seed);
  MipTexture(MipTexture&&) = default;
  MipTexture(const MipTexture&) = delete;
  MipTexture& operator=(const MipTexture&) = delete;

  /// Gray value at (u, v) in texels * 2^kFractionBits of level 0; `level` in 1/256 of a level, within
  /// [0, (kLevels - 1) * 256].
  int sample(int u, int v, int level) const {
    const int fine = level >> 8, blend = level & 255;
    const unsigned low = bilinear(fine, u, v);
    if (blend == 0) return static_cast<int>(low >> 8);
    const unsigned high = bilinear(fine + 1, u, v);
    return static_cast<int>((low * (256U - blend) + high * blend) >> 16);
  }

 private:
  // Gray * 256 on one level. Both rows are blended at once, each in its half of a word.
  unsigned bilinear(int level, int u, int v) const {
    const Level& texels = levels_[level];
    const int x = (u >> level) - 128, y = (v >> level) - 128;
    const unsigned fx = x & 255, fy = y & 255;
    const std::uint8_t* top =
        texels.first + ((y >> 8) & texels.mask) * texels.stride + ((x >> 8) & texels.mask);
    const std::uint8_t* bottom = top + texels.stride;
    const unsigned left = top[0] | static_cast<unsigned>(bottom[0]) << 16;
    const unsigned right = top[1] | static_cast<unsigned>(bottom[1]) << 16;
    const unsigned rows = left * (256 - fx) + right * fx;
    return ((rows & 0xFFFF) * (256 - fy) + (rows >> 16) * fy) >> 8;
  }

  // The first row and column are repeated at the end, so that neighbours need no wrapping.
  struct Level {
    const std::uint8_t* first;
    int stride, mask;
  };

  std::vector<std::uint8_t> texels_;
  std::vector<Level> levels_;
};

}  // namespace autocal_vio
