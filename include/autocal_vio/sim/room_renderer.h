// Images of a Room through a distorting lens, by casting one ray per pixel.
//
//   const Room room = Room::around(trajectory, seed);
//   RoomRenderer renderer(room, camera, seed);
//   cv::Mat image;
//   renderer.render(T_WB * T_imu_cam, &image);
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "autocal_vio/camera/camera_model.h"
#include "autocal_vio/geometry/transform.h"
#include "autocal_vio/sim/mip_texture.h"
#include "autocal_vio/sim/room.h"

namespace autocal_vio {

/// Sharp, noise-free images: the geometry of every pixel's centre is exact (float), texture is filtered over
/// the pixel's footprint and edges between surfaces are supersampled, so that corners can be tracked to a
/// fraction of a pixel. Global shutter, no exposure time. Not thread-safe: it keeps scratch memory.
class RoomRenderer {
 public:
  /// `seed`: of the textures.
  RoomRenderer(const Room& room, const CameraModel& camera, std::uint64_t seed);

  /// Renders into `image`, CV_8UC1 of the camera's size. Pixels that the lens model cannot undistort are
  /// black. The camera must be inside the room and outside the obstacles; elsewhere the image is meaningless.
  void render(const Transform& T_WC, cv::Mat* image);

 private:
  static constexpr int kTileSize = 16;  ///< pixels are worked on in square tiles
  static constexpr int kTilePixels = kTileSize * kTileSize;

  /// How one face of a box is painted.
  struct Face {
    const MipTexture* texture;
    int axis;                  ///< of the face's normal
    int axis_u, axis_v;        ///< axes of W that run along the texture's
    float offset_u, offset_v;  ///< of this image: (camera position * texels per metre + own offset) * 256
    float shift_u, shift_v;    ///< own offset [texel]
    int gain;                  ///< brightness, 256 is 1
  };
  /// A box relative to the camera's position [m].
  struct Slab {
    float low[3], high[3];
  };
  /// A cone around the rays of a tile, camera frame.
  struct Cone {
    Eigen::Vector3f axis;  ///< unit
    float cosine, sine;    ///< of half its angle
  };
  /// A sphere around a part of an obstacle, camera frame.
  struct Sphere {
    int box;
    Eigen::Vector3f center;
    float distance, cosine, sine;  ///< cosine and sine of half the angle under which it is seen
    bool everywhere;               ///< the camera is inside it
  };
  struct Hits;

  void makeRays(const CameraModel& camera);
  void makeCones();
  void makeFaces(std::uint64_t seed);
  void prepare(const Transform& T_WC);
  void addSpheres(int box, const Transform& T_CW);
  void findCandidates(const Cone& cone, std::vector<int>* boxes) const;
  void cast(const float* ray_x, const float* ray_y, int count, const std::vector<int>& boxes,
            Hits* hits) const;
  void shade(const Hits& hits, int begin, int end, const float* area, std::uint8_t* gray) const;
  void renderTile(int tile, cv::Mat* image);
  bool hasEdges(int tile) const;
  void smoothEdges(int tile, cv::Mat* image) const;
  void smoothPixels(const std::vector<cv::Point>& pixels, const std::vector<int>& boxes,
                    cv::Mat* image) const;
  /// Of a pixel in the arrays below: tile by tile, row by row in the tile.
  int index(int x, int y) const {
    return (y / kTileSize * tile_columns_ + x / kTileSize) * kTilePixels + y % kTileSize * kTileSize +
           x % kTileSize;
  }

  Room room_;
  int width_, height_, tile_columns_, tile_rows_;
  std::vector<MipTexture> textures_;
  std::vector<Face> faces_;  ///< six of the walls, then six of each obstacle: -x +x -y +y -z +z
  std::vector<float> ray_x_, ray_y_, area_;  ///< per pixel: normalised coordinates, |d normalised / d pixel|
  std::vector<cv::Point> black_;             ///< pixels that see nothing
  std::vector<Cone> cones_;

  // Of the image being rendered.
  Eigen::Matrix3f R_WC_ = Eigen::Matrix3f::Identity();
  std::vector<Slab> slabs_;  ///< walls, then obstacles
  std::vector<Sphere> spheres_;
  std::vector<std::vector<int>> candidates_;  ///< obstacles that each tile may see, as indices of slabs_
  std::vector<std::uint8_t> face_of_;         ///< per pixel
  std::vector<int> tile_face_;                ///< the one face that fills a tile, or -1
};

}  // namespace autocal_vio
