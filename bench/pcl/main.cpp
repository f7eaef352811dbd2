// PCL's part of the benchmark.
#include <pcl/console/print.h>
#include <pcl/pcl_config.h>

#include "stages.hpp"

int main(int argc, char** argv) {
  pcl::console::setVerbosityLevel(pcl::console::L_ERROR);
  return bench::run(argc, argv, "PCL", PCL_VERSION_PRETTY,
                    {{"read-pcd-ascii", stages::read_pcd_ascii},
                     {"read-pcd-binary", stages::read_pcd_binary},
                     {"read-pcd-compressed", stages::read_pcd_compressed},
                     {"read-ply", stages::read_ply},
                     {"voxel", stages::voxel},
                     {"outliers", stages::outliers},
                     {"tree", stages::tree},
                     {"nearest", stages::nearest},
                     {"knn", stages::knn},
                     {"radius", stages::radius},
                     {"normals-knn", stages::normals_knn},
                     {"normals-radius", stages::normals_radius},
                     {"iss", stages::iss},
                     {"fpfh-all", stages::fpfh_all},
                     {"fpfh-keypoints", stages::fpfh_keypoints},
                     {"match", stages::match},
                     {"match-mutual", stages::match_mutual},
                     {"ransac", stages::ransac},
                     {"ndt", stages::ndt},
                     {"icp-point", stages::icp_point},
                     {"icp-plane", stages::icp_plane},
                     {"gicp", stages::gicp},
                     {"chain", stages::chain}});
}
