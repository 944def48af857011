// Compressed images (PNG, JPEG and what else OpenCV knows).
#pragma once

#include <cstddef>
#include <opencv2/core/mat.hpp>

namespace autocal_vio {

/// A grey 8-bit image; empty when the bytes are no complete image.
cv::Mat decodeGrey(const void* bytes, std::size_t size);

}  // namespace autocal_vio
