// PCL side of the peer comparison. Reads cloud.csv, stations.csv, outliers.csv
// and moved.csv from the current folder and writes every *_pcl*.csv, plus
// normals.csv and the PCL rows of poses.csv.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include <pcl/features/fpfh.h>
#include <pcl/features/normal_3d.h>
#include <pcl/filters/radius_outlier_removal.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/keypoints/iss_3d.h>
#include <pcl/pcl_config.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/ndt.h>
#include <pcl/search/kdtree.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<pcl::PointXYZ>;

namespace {

constexpr int kViewpointStation = 7;
constexpr int kStride = 10;  // rows written of per-point results
constexpr double kFpfhRadius = 1.25;

std::vector<std::vector<double>> readRows(const std::string& name) {
  std::ifstream in(name);
  if (!in) {
    std::cerr << "cannot read " << name << "\n";
    std::exit(1);
  }
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::vector<double> row;
    std::istringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');) row.push_back(std::stod(field));
    rows.push_back(row);
  }
  return rows;
}

Cloud::Ptr readCloud(const std::string& name) {
  Cloud::Ptr cloud(new Cloud);
  for (const auto& r : readRows(name))
    cloud->push_back(pcl::PointXYZ(float(r[0]), float(r[1]), float(r[2])));
  return cloud;
}

class Csv {
public:
  Csv(const std::string& name, const std::string& what) : out_(name) {
    out_ << "# " << what << ", by PCL " << PCL_VERSION_PRETTY << "\n";
  }
  Csv& operator<<(double v) {
    char text[40];
    std::snprintf(text, sizeof text, format_, v);
    return put(text);
  }
  Csv& operator<<(const std::string& s) { return put(s); }
  Csv& operator<<(const char* s) { return put(s); }
  void end() {
    out_ << "\n";
    first_ = true;
  }
  void format(const char* f) { format_ = f; }

private:
  Csv& put(const std::string& s) {
    if (!first_) out_ << ",";
    out_ << s;
    first_ = false;
    return *this;
  }
  std::ofstream out_;
  const char* format_ = "%.7g";
  bool first_ = true;
};

void writeIndices(const std::string& name, const std::string& what, pcl::Indices idx) {
  std::sort(idx.begin(), idx.end());
  Csv csv(name, what);
  for (auto i : idx) {
    csv << double(i);
    csv.end();
  }
  std::cout << name << ": " << idx.size() << "\n";
}

Normals estimateNormals(const Cloud::Ptr& cloud, int k, double radius, const Eigen::Vector3f& eye) {
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> ne;
  ne.setInputCloud(cloud);
  ne.setSearchMethod(Tree::Ptr(new Tree));
  if (k > 0)
    ne.setKSearch(k);
  else
    ne.setRadiusSearch(radius);
  ne.setViewPoint(eye.x(), eye.y(), eye.z());
  Normals out;
  ne.compute(out);
  return out;
}

void writeNormals(const std::string& name, const std::string& what, const Normals& n) {
  Csv csv(name, "index,nx,ny,nz,curvature of every 10th point of cloud.csv: NormalEstimation, " + what +
                    ", flipped towards row 7 of stations.csv");
  for (std::size_t i = 0; i < n.size(); i += kStride) {
    csv << double(i) << n[i].normal_x << n[i].normal_y << n[i].normal_z << n[i].curvature;
    csv.end();
  }
}

/// Normals for the features: each flipped towards its own nearest station.
void writeGivenNormals(const Cloud& cloud, Normals n, const Cloud& stations) {
  Csv csv("normals.csv",
          "nx,ny,nz, one row per row of cloud.csv: NormalEstimation radius 0.8, flipped towards the nearest "
          "row of stations.csv, 6 decimals (divide by the length after reading)");
  csv.format("%.6f");
  for (std::size_t i = 0; i < n.size(); ++i) {
    const Eigen::Vector3f p = cloud[i].getVector3fMap();
    const auto near = std::min_element(stations.begin(), stations.end(), [&](const auto& a, const auto& b) {
      return (a.getVector3fMap() - p).squaredNorm() < (b.getVector3fMap() - p).squaredNorm();
    });
    pcl::flipNormalTowardsViewpoint(cloud[i], near->x, near->y, near->z, n[i].normal_x, n[i].normal_y,
                                    n[i].normal_z);
    csv << n[i].normal_x << n[i].normal_y << n[i].normal_z;
    csv.end();
  }
}

Normals::Ptr readGivenNormals() {
  Normals::Ptr out(new Normals);
  for (const auto& r : readRows("normals.csv")) {
    const double len = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    out->push_back(pcl::Normal(float(r[0] / len), float(r[1] / len), float(r[2] / len)));
  }
  return out;
}

struct Feature {
  pcl::PointCloud<pcl::FPFHSignature33> fpfh;
  Eigen::MatrixXf spfh;  // one row of 33 per point
};

Feature computeFpfh(const Cloud::Ptr& cloud, const Normals::Ptr& normals) {
  Feature f;
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> fe;
  Tree::Ptr tree(new Tree(false));
  tree->setInputCloud(cloud);
  fe.setInputCloud(cloud);
  fe.setInputNormals(normals);
  fe.setSearchMethod(tree);
  fe.setRadiusSearch(kFpfhRadius);
  fe.compute(f.fpfh);

  const int n = int(cloud->size());
  Eigen::MatrixXf h1 = Eigen::MatrixXf::Zero(n, 11), h2 = h1, h3 = h1;
  pcl::Indices near;
  std::vector<float> d2;
  for (int i = 0; i < n; ++i) {
    tree->radiusSearch(i, kFpfhRadius, near, d2);
    fe.computePointSPFHSignature(*cloud, *normals, i, i, near, h1, h2, h3);
  }
  f.spfh.resize(n, 33);
  f.spfh << h1, h2, h3;
  return f;
}

void row33(Csv& csv, const float* v, int stride) {
  for (int k = 0; k < 33; ++k) csv << v[k * stride];
  csv.end();
}

void features(const Cloud::Ptr& cloud, const Normals::Ptr& normals) {
  const Feature f = computeFpfh(cloud, normals);
  const int n = int(cloud->size());
  Csv fpfh("fpfh_pcl.csv",
           "index, then 33 FPFH bins (11 f1, 11 f2, 11 f3) of every 10th point: FPFHEstimation, radius 1.25, "
           "cloud.csv with normals.csv");
  Csv spfh("spfh_pcl.csv",
           "index, then 33 SPFH bins (11 f1, 11 f2, 11 f3) of every 10th point: "
           "FPFHEstimation::computePointSPFHSignature, radius 1.25, cloud.csv with normals.csv");
  for (int i = 0; i < n; i += kStride) {
    fpfh << double(i);
    row33(fpfh, f.fpfh[i].histogram, 1);
    spfh << double(i);
    row33(spfh, &f.spfh(i, 0), n);
  }

  Cloud::Ptr twice(new Cloud(*cloud));
  Normals::Ptr twice_normals(new Normals(*normals));
  twice->push_back((*cloud)[0]);
  twice_normals->push_back((*normals)[0]);
  const Feature g = computeFpfh(twice, twice_normals);
  Csv dup("fpfh_duplicate_pcl.csv",
          "name, then 33 bins of point 0 after row 0 of cloud.csv and normals.csv is appended once more: "
          "radius 1.25");
  dup << "fpfh";
  row33(dup, g.fpfh[0].histogram, 1);
  dup << "spfh";
  row33(dup, &g.spfh(0, 0), n + 1);
}

void keypoints(const Cloud::Ptr& cloud) {
  pcl::ISSKeypoint3D<pcl::PointXYZ, pcl::PointXYZ> iss;
  iss.setInputCloud(cloud);
  iss.setSearchMethod(Tree::Ptr(new Tree));
  iss.setSalientRadius(1.0);
  iss.setNonMaxRadius(0.75);
  iss.setThreshold21(0.975);
  iss.setThreshold32(0.975);
  iss.setMinNeighbors(5);
  iss.setNumberOfThreads(1);
  Cloud out;
  iss.compute(out);
  writeIndices("iss_pcl.csv",
               "indices of the ISSKeypoint3D keypoints of cloud.csv: salient 1.0, non-max 0.75, gamma21 = gamma32 = "
               "0.975, min neighbours 5, no border estimation",
               iss.getKeypointsIndices()->indices);
}

void outlierRemoval() {
  const Cloud::Ptr cloud = readCloud("outliers.csv");
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> sor(true);
  sor.setInputCloud(cloud);
  sor.setMeanK(16);
  sor.setStddevMulThresh(1.0);
  pcl::Indices kept;
  sor.filter(kept);
  writeIndices("removed_statistical_pcl.csv",
               "removed indices of outliers.csv (all others are kept): StatisticalOutlierRemoval, mean k 16, "
               "stddev multiplier 1.0",
               *sor.getRemovedIndices());

  pcl::RadiusOutlierRemoval<pcl::PointXYZ> ror(true);
  ror.setInputCloud(cloud);
  ror.setRadiusSearch(0.6);
  ror.setMinNeighborsInRadius(5);
  ror.filter(kept);
  writeIndices("removed_radius_pcl.csv",
               "removed indices of outliers.csv (all others are kept): RadiusOutlierRemoval, radius 0.6, "
               "min neighbours 5",
               *ror.getRemovedIndices());
}

void voxels(const Cloud::Ptr& cloud) {
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  grid.setInputCloud(cloud);
  grid.setLeafSize(0.5f, 0.5f, 0.5f);
  Cloud out;
  grid.filter(out);
  std::vector<std::array<double, 3>> rows;
  for (const auto& p : out)
    rows.push_back({std::round(p.x * 1e5) / 1e5, std::round(p.y * 1e5) / 1e5, std::round(p.z * 1e5) / 1e5});
  std::sort(rows.begin(), rows.end());
  Csv csv("voxel_pcl.csv",
          "x,y,z centroids (" + std::to_string(rows.size()) +
              " cells) of cloud.csv, 5 decimals, sorted: VoxelGrid, leaf 0.5");
  csv.format("%.5f");
  for (const auto& r : rows) {
    csv << r[0] << r[1] << r[2];
    csv.end();
  }
  std::cout << "voxels: " << rows.size() << "\n";
}

void pose(Csv& csv, const std::string& name, const Eigen::Matrix4f& t, bool converged) {
  csv << name;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) csv << t(r, c);
  csv.end();
  std::cout << name << (converged ? " converged\n" : " did not converge\n");
}

void registration(const Cloud::Ptr& target) {
  const Cloud::Ptr source = readCloud("moved.csv");
  Csv csv("poses.csv", "rows to be completed by make_open3d.py");
  csv.format("%.9g");
  Cloud aligned;

  pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ> icp;
  icp.setInputSource(source);
  icp.setInputTarget(target);
  icp.setMaxCorrespondenceDistance(1.0);
  icp.setMaximumIterations(200);
  icp.setTransformationEpsilon(1e-14);
  icp.setTransformationRotationEpsilon(1.0 - 1e-14);
  icp.setEuclideanFitnessEpsilon(1e-12);
  icp.align(aligned);
  pose(csv, "pcl_icp_point", icp.getFinalTransformation(), icp.hasConverged());

  pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ> ndt;
  ndt.setResolution(2.0f);
  ndt.setStepSize(0.1);
  ndt.setTransformationEpsilon(1e-4);
  ndt.setInputSource(source);
  ndt.setInputTarget(target);
  ndt.align(aligned);
  pose(csv, "pcl_ndt", ndt.getFinalTransformation(), ndt.hasConverged());
  std::cout << "ndt iterations " << ndt.getFinalNumIteration() << " of at most " << ndt.getMaximumIterations()
            << "\n";
}

/// Small experiments whose answer is a convention; see README.md.
void conventions() {
  Csv csv("conventions_pcl.csv", "name,value: small experiments described in README.md");
  const auto note = [&](const char* name, double value) {
    csv << name << value;
    csv.end();
  };
  // Exact in binary: a point at 0, four at distance 1, four at distance 0.5.
  Cloud::Ptr cross(new Cloud);
  cross->push_back(pcl::PointXYZ(0, 0, 0));
  for (float s : {-1.0f, 1.0f, -0.5f, 0.5f}) {
    cross->push_back(pcl::PointXYZ(s, 0, 0));
    cross->push_back(pcl::PointXYZ(0, s, 0));
  }
  Tree tree;
  tree.setInputCloud(cross);
  pcl::Indices idx;
  std::vector<float> d2;
  note("radius_1_count_of_9", tree.radiusSearch(0, 1.0, idx, d2));
  note("knn_first_is_self", tree.nearestKSearch(0, 3, idx, d2) == 3 && idx[0] == 0);

  // Radius removal at radius exactly 1: all eight others of point 0 lie within it.
  for (int min_pts : {8, 9}) {
    pcl::RadiusOutlierRemoval<pcl::PointXYZ> ror;
    ror.setInputCloud(cross);
    ror.setRadiusSearch(1.0);
    ror.setMinNeighborsInRadius(min_pts);
    pcl::Indices kept;
    ror.filter(kept);
    note(min_pts == 8 ? "radius_removal_keeps_centre_with_min_8" : "radius_removal_keeps_centre_with_min_9",
         std::count(kept.begin(), kept.end(), 0));
  }

  // Nearest distances 1,1,1,1,2: the last point is above mean + 1.9 stddev only
  // with the population stddev, above mean + 1.7 stddev with either.
  const auto kept_on_line = [](const std::vector<float>& xs, double multiplier) {
    Cloud::Ptr line(new Cloud);
    for (float x : xs) line->push_back(pcl::PointXYZ(x, 0, 0));
    pcl::StatisticalOutlierRemoval<pcl::PointXYZ> sor;
    sor.setInputCloud(line);
    sor.setMeanK(1);
    sor.setStddevMulThresh(multiplier);
    pcl::Indices kept;
    sor.filter(kept);
    return double(kept.size());
  };
  note("statistical_1.7_kept_of_5", kept_on_line({0, 1, 2, 3, 5}, 1.7));
  note("statistical_1.9_kept_of_5", kept_on_line({0, 1, 2, 3, 5}, 1.9));
  // All mean distances equal the threshold exactly.
  note("statistical_all_equal_kept_of_4", kept_on_line({0, 1, 2, 3}, 1.0));
}

}  // namespace

int main() {
  const Cloud::Ptr cloud = readCloud("cloud.csv");
  const Cloud::Ptr stations = readCloud("stations.csv");
  const Eigen::Vector3f eye = (*stations)[kViewpointStation].getVector3fMap();

  writeNormals("normals_pcl_k20.csv", "k = 20 (the point is one of the 20)", estimateNormals(cloud, 20, 0.0, eye));
  const Normals r08 = estimateNormals(cloud, 0, 0.8, eye);
  writeNormals("normals_pcl_r08.csv", "radius 0.8", r08);
  writeGivenNormals(*cloud, r08, *stations);

  features(cloud, readGivenNormals());
  keypoints(cloud);
  outlierRemoval();
  voxels(cloud);
  registration(cloud);
  conventions();
  return 0;
}
