// Reading, thinning and cleaning.
#include <pcl/common/common.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>

#include <algorithm>
#include <limits>

#include "stages.hpp"

namespace stages {

namespace {

using Intense = pcl::PointCloud<pcl::PointXYZI>;

void read(const bench::Arguments& args, const std::string& name, int (*load)(const std::string&, Intense&)) {
  const std::string path = args.file(name).string();
  bench::measure(
      args, "no threads",
      [&] {
        auto cloud = std::make_unique<Intense>();
        if (load(path, *cloud) < 0) throw std::runtime_error("PCL cannot read " + path);
        return cloud;
      },
      [](const std::unique_ptr<Intense>& cloud) {
        std::vector<double> mean(3, 0.0);
        for (const auto& point : *cloud) {
          for (int axis = 0; axis < 3; ++axis) mean[axis] += point.data[axis];
        }
        for (double& m : mean) m /= static_cast<double>(cloud->size());
        return bench::output(mean, cloud->size());
      });
}

int load_pcd(const std::string& path, Intense& cloud) { return pcl::io::loadPCDFile(path, cloud); }
int load_ply(const std::string& path, Intense& cloud) { return pcl::io::loadPLYFile(path, cloud); }

}  // namespace

Cloud::Ptr cloud(const bench::Arguments& args, const std::string& name) {
  const auto xyz = bench::array<float>(args.file(name));
  auto points = std::make_shared<Cloud>();
  points->reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) points->emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return points;
}

Normals::Ptr normals(const bench::Arguments& args, const std::string& name) {
  const auto xyz = bench::array<float>(args.file(name));
  auto normals = std::make_shared<Normals>();
  normals->reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) normals->emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return normals;
}

pcl::Indices indices(const bench::Arguments& args, const std::string& name) {
  const auto numbers = bench::array<std::uint32_t>(args.file(name));
  return {numbers.begin(), numbers.end()};
}

Cloud::Ptr chosen(const Cloud& cloud, const pcl::Indices& indices) {
  auto points = std::make_shared<Cloud>();
  points->reserve(indices.size());
  for (const auto i : indices) points->push_back(cloud.at(i));
  return points;
}

bench::Output show(const pcl::Indices& indices) {
  std::vector<std::uint32_t> ascending(indices.begin(), indices.end());
  std::sort(ascending.begin(), ascending.end());
  return bench::output(ascending, ascending.size());
}

pcl::Indices inliers(const Cloud::Ptr& cloud) {
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
  filter.setInputCloud(cloud);
  filter.setMeanK(NEIGHBOURS);
  filter.setStddevMulThresh(2.0);
  pcl::Indices kept;
  filter.filter(kept);
  return kept;
}

Cloud::Ptr thinned(const Cloud::Ptr& cloud, double v) {
  const auto side = static_cast<float>(v);
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  grid.setInputCloud(cloud);
  grid.setLeafSize(side, side, side);
  auto thin = std::make_shared<Cloud>();
  grid.filter(*thin);
  return thin;
}

void read_pcd_ascii(const bench::Arguments& args) { read(args, "map.ascii.pcd", load_pcd); }
void read_pcd_binary(const bench::Arguments& args) { read(args, "map.pcd", load_pcd); }
void read_pcd_compressed(const bench::Arguments& args) { read(args, "map.compressed.pcd", load_pcd); }
void read_ply(const bench::Arguments& args) { read(args, "map.ply", load_ply); }

void voxel(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map.f32");
  const double v = bench::setting(args, "voxel");
  // Where its 32-bit cell numbers run out VoxelGrid warns and gives the cloud back as it was.
  pcl::PointXYZ low, high;
  pcl::getMinMax3D(*map, low, high);
  const Eigen::Array3d cells = ((high.getArray3fMap() - low.getArray3fMap()).cast<double>() / v).floor() + 1.0;
  if (cells.prod() > std::numeric_limits<std::int32_t>::max()) throw std::runtime_error("VoxelGrid has too few cell numbers for this cloud");
  bench::measure(
      args, "VoxelGrid; no threads", [&] { return thinned(map, v); },
      [](const Cloud::Ptr& thin) {
        std::vector<float> xyz;
        xyz.reserve(3 * thin->size());
        for (const auto& point : *thin) xyz.insert(xyz.end(), point.data, point.data + 3);
        return bench::output(xyz, thin->size());
      });
}

void outliers(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  bench::measure(args, "StatisticalOutlierRemoval; no threads", [&] { return inliers(map); }, show);
}

}  // namespace stages
