// Normals, keypoints, features and their matching.
#include <pcl/features/fpfh_omp.h>
#include <pcl/features/normal_3d_omp.h>
#include <pcl/keypoints/iss_3d.h>
#include <pcl/registration/correspondence_estimation.h>
#include <pcl/search/kdtree.h>

#include "stages.hpp"

namespace stages {

namespace {

using Search = pcl::search::KdTree<pcl::PointXYZ>;
using Estimation = pcl::registration::CorrespondenceEstimation<pcl::FPFHSignature33, pcl::FPFHSignature33>;

// With the `k` nearest neighbours, or where `k` is 0 with all within `radius`.
Normals::Ptr estimated(const Cloud::Ptr& cloud, int k, double radius, int threads) {
  pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(static_cast<unsigned>(threads));
  estimation.setInputCloud(cloud);
  estimation.setSearchMethod(std::make_shared<Search>(false));
  if (k > 0) {
    estimation.setKSearch(k);
  } else {
    estimation.setRadiusSearch(radius);
  }
  auto normals = std::make_shared<Normals>();
  estimation.compute(*normals);
  return normals;
}

bench::Output show_normals(const Normals::Ptr& normals) {
  std::vector<float> xyz;
  xyz.reserve(3 * normals->size());
  for (const auto& n : *normals) xyz.insert(xyz.end(), n.normal, n.normal + 3);
  return bench::output(xyz, normals->size());
}

bench::Output show_features(const Features::Ptr& features) {
  std::vector<float> bins;
  bins.reserve(33 * features->size());
  for (const auto& f : *features) bins.insert(bins.end(), f.histogram, f.histogram + 33);
  return bench::output(bins, features->size());
}

Features::Ptr features(const bench::Arguments& args, const std::string& name) {
  const auto bins = bench::array<float>(args.file(name));
  auto features = std::make_shared<Features>();
  features->resize(bins.size() / 33);
  for (std::size_t i = 0; i < features->size(); ++i) std::copy_n(&bins[33 * i], 33, (*features)[i].histogram);
  return features;
}

bench::Output show_matches(const pcl::CorrespondencesPtr& matches) {
  std::vector<std::uint32_t> pairs;
  for (const auto& match : *matches) {
    pairs.push_back(static_cast<std::uint32_t>(match.index_query));
    pairs.push_back(static_cast<std::uint32_t>(match.index_match));
  }
  return bench::output(pairs, matches->size());
}

}  // namespace

Normals::Ptr normals_of(const Cloud::Ptr& cloud, int threads) { return estimated(cloud, NEIGHBOURS, 0.0, threads); }

pcl::Indices keypoints_of(const Cloud::Ptr& cloud, double v, int threads) {
  pcl::ISSKeypoint3D<pcl::PointXYZ, pcl::PointXYZ> detector;
  detector.setInputCloud(cloud);
  detector.setSearchMethod(std::make_shared<Search>(false));
  detector.setSalientRadius(6.0 * v);
  detector.setNonMaxRadius(4.0 * v);
  detector.setThreshold21(0.975);
  detector.setThreshold32(0.975);
  detector.setMinNeighbors(5);
  detector.setNumberOfThreads(static_cast<unsigned>(threads));
  Cloud points;
  detector.compute(points);
  return detector.getKeypointsIndices()->indices;
}

Features::Ptr features_of(const Cloud::Ptr& points, const Cloud::Ptr& cloud, const Normals::Ptr& normals, double v, int threads) {
  pcl::FPFHEstimationOMP<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation(static_cast<unsigned>(threads));
  estimation.setInputCloud(points);
  if (points != cloud) estimation.setSearchSurface(cloud);
  estimation.setInputNormals(normals);
  estimation.setSearchMethod(std::make_shared<Search>(false));
  estimation.setRadiusSearch(5.0 * v);
  auto features = std::make_shared<Features>();
  estimation.compute(*features);
  return features;
}

pcl::CorrespondencesPtr matches_of(const Features::Ptr& query, const Features::Ptr& map, bool mutual) {
  Estimation estimation;
  estimation.setInputSource(query);
  estimation.setInputTarget(map);
  auto matches = std::make_shared<pcl::Correspondences>();
  if (mutual) {
    estimation.determineReciprocalCorrespondences(*matches);
  } else {
    estimation.determineCorrespondences(*matches);
  }
  return matches;
}

void normals_knn(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  bench::measure(args, "NormalEstimationOMP", [&] { return normals_of(map, args.threads); }, show_normals);
}

void normals_radius(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  const double length = 2.5 * bench::setting(args, "voxel");
  bench::measure(args, "NormalEstimationOMP", [&] { return estimated(map, 0, length, args.threads); }, show_normals);
}

void iss(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  const double v = bench::setting(args, "voxel");
  bench::measure(args, "ISSKeypoint3D, no borders", [&] { return keypoints_of(map, v, args.threads); }, show);
}

void fpfh_all(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  const Normals::Ptr given = normals(args, "map_normals.f32");
  const double v = bench::setting(args, "voxel");
  bench::measure(args, "FPFHEstimationOMP", [&] { return features_of(map, map, given, v, args.threads); }, show_features);
}

void fpfh_keypoints(const bench::Arguments& args) {
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  const Normals::Ptr given = normals(args, "map_normals.f32");
  const Cloud::Ptr keypoints = chosen(*map, indices(args, "map_keypoints.u32"));
  const double v = bench::setting(args, "voxel");
  bench::measure(
      args, "FPFHEstimationOMP; which points it needs is found without threads", [&] { return features_of(keypoints, map, given, v, args.threads); }, show_features);
}

namespace {

void matched(const bench::Arguments& args, bool mutual) {
  const Features::Ptr query = features(args, "query_fpfh.f32");
  const Features::Ptr map = features(args, "map_fpfh.f32");
  bench::measure(args, "CorrespondenceEstimation; no threads", [&] { return matches_of(query, map, mutual); }, show_matches);
}

}  // namespace

void match(const bench::Arguments& args) { matched(args, false); }
void match_mutual(const bench::Arguments& args) { matched(args, true); }

}  // namespace stages
