// Poses: from correspondences, from a near start, and the whole chain.
#include <pcl/common/centroid.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/ndt.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_registration.h>

#include <cmath>

#include "stages.hpp"

namespace stages {

namespace {

using Oriented = pcl::PointCloud<pcl::PointNormal>;

constexpr double PAIRS_WITHIN = 1.0;
constexpr int ICP_ITERATIONS = 50;
constexpr double STEP = 0.0005;   // metres
constexpr double TURN = 0.00005;  // radians
constexpr double NDT_STEP = 0.5;  // metres, the longest step: half a cell, as winze has it

using Rows = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
using Poses = std::vector<Eigen::Matrix4d>;

Poses starts(const bench::Arguments& args) {
  const auto numbers = bench::array<double>(args.file("start.f64"));
  if (numbers.empty() || numbers.size() % 16 != 0) throw std::runtime_error("start.f64 holds no 4 x 4 matrices");
  Poses poses;
  for (std::size_t i = 0; i < numbers.size(); i += 16) poses.emplace_back(Eigen::Map<const Rows>(&numbers[i]));
  return poses;
}

bench::Output show_poses(const Poses& poses) {
  std::vector<double> numbers(16 * poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) Eigen::Map<Rows>{&numbers[16 * i]} = poses[i];
  return bench::output(numbers, 0);
}

bench::Output show_pose(const Eigen::Matrix4d& pose) { return show_poses({pose}); }

// Times `refine(start)` of all near starts, one after the other: what it makes is made anew for each.
template <class Refine>
void refined(const bench::Arguments& args, const std::string& note, Refine refine) {
  const Poses from = starts(args);
  bench::measure(
      args, note,
      [&] {
        Poses poses;
        for (const auto& start : from) poses.push_back(refine(start));
        return poses;
      },
      show_poses);
}

Oriented::Ptr oriented(const Cloud& cloud, const Normals& normals) {
  auto points = std::make_shared<Oriented>();
  pcl::concatenateFields(cloud, normals, *points);
  return points;
}

// Of the two criteria PCL takes the square of the step and the cosine of the turn, which single precision cannot tell from 1: hence `double`.
template <class Icp>
Eigen::Matrix4d icp_from(Icp& icp, const Eigen::Matrix4d& guess) {
  icp.setMaxCorrespondenceDistance(PAIRS_WITHIN);
  icp.setMaximumIterations(ICP_ITERATIONS);
  icp.setTransformationEpsilon(STEP * STEP);
  icp.setTransformationRotationEpsilon(std::cos(TURN));
  typename Icp::PointCloudSource moved;
  icp.align(moved, guess);
  return icp.getFinalTransformation();
}

Eigen::Matrix4d icp_of_points(const Cloud::Ptr& query, const Cloud::Ptr& map, const Eigen::Matrix4d& guess) {
  pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ, double> icp;
  icp.setInputSource(query);
  icp.setInputTarget(map);
  return icp_from(icp, guess);
}

// NDT and GICP search for angles about the map's origin, which is moved to the query's middle: far from it a small turn is a long way.
template <class Alignment>
Eigen::Matrix4d aligned_there(Alignment& alignment, const Cloud::Ptr& query, const Cloud::Ptr& map, const Eigen::Matrix4d& guess) {
  Eigen::Vector4d middle = Eigen::Vector4d::UnitW();
  pcl::compute3DCentroid(*query, middle);
  middle = guess * middle;
  const Eigen::Translation3d there(middle.head<3>());
  auto moved_map = std::make_shared<Cloud>();
  pcl::demeanPointCloud(*map, middle, *moved_map);
  alignment.setInputSource(query);
  alignment.setInputTarget(moved_map);
  Cloud moved;
  alignment.align(moved, (there.inverse() * Eigen::Affine3d(guess)).matrix().template cast<typename Alignment::Matrix4::Scalar>());
  return (there * Eigen::Affine3d(alignment.getFinalTransformation().template cast<double>())).matrix();
}

Eigen::Matrix4d ndt_of(const Cloud::Ptr& query, const Cloud::Ptr& map, const Eigen::Matrix4d& guess) {
  pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ> ndt;
  ndt.setResolution(1.0f);
  ndt.setStepSize(NDT_STEP);
  ndt.setMaximumIterations(30);
  ndt.setTransformationEpsilon(0.001 * 0.001);
  return aligned_there(ndt, query, map, guess);
}

struct Described {
  Cloud::Ptr thin;
  Cloud::Ptr keypoints;
  Features::Ptr features;
};

// The chain's work on one raw cloud.
Described described(const Cloud::Ptr& raw, double v, int threads) {
  const Cloud::Ptr thin = thinned(chosen(*raw, inliers(raw)), v);
  const Normals::Ptr normals = normals_of(thin, threads);
  const Cloud::Ptr keypoints = chosen(*thin, keypoints_of(thin, v, threads));
  const Features::Ptr features = features_of(keypoints, thin, normals, v, threads);
  return {thin, keypoints, features};
}

}  // namespace

// `query[i]` and `map[i]` correspond. By PCL's sampler and its model of a registration, which take the threads and the confidence.
Eigen::Matrix4d pose_of(const Cloud::Ptr& query, const Cloud::Ptr& map, double v, int threads) {
  auto model = std::make_shared<pcl::SampleConsensusModelRegistration<pcl::PointXYZ>>(query);
  model->setInputTarget(map);
  pcl::RandomSampleConsensus<pcl::PointXYZ> sampler(model, 2.0 * v);
  sampler.setMaxIterations(100'000);
  sampler.setProbability(0.999);
  sampler.setNumberOfThreads(threads);
  if (!sampler.computeModel()) throw std::runtime_error("RANSAC found no pose");
  pcl::Indices supporting;
  Eigen::VectorXf rows, fitted;
  sampler.getInliers(supporting);
  sampler.getModelCoefficients(rows);
  model->optimizeModelCoefficients(supporting, rows, fitted);
  return Eigen::Map<const Eigen::Matrix<float, 4, 4, Eigen::RowMajor>>(fitted.data()).cast<double>();
}

void ransac(const bench::Arguments& args) {
  const auto pairs = indices(args, "correspondences.u32");
  const auto side = [&](const std::string& name, std::size_t which) {
    const auto keypoints = indices(args, name + "_keypoints.u32");
    pcl::Indices points;
    for (std::size_t i = which; i < pairs.size(); i += 2) points.push_back(keypoints.at(pairs[i]));
    return chosen(*cloud(args, name + "_thin.f32"), points);
  };
  const Cloud::Ptr query = side("query", 0);
  const Cloud::Ptr map = side("map", 1);
  const double v = bench::setting(args, "voxel");
  bench::measure(
      args, "RandomSampleConsensus with SampleConsensusModelRegistration; no edge similarity", [&] { return pose_of(query, map, v, args.threads); },
      show_pose);
}

void ndt(const bench::Arguments& args) {
  const Cloud::Ptr query = cloud(args, "query_thin.f32");
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  refined(args, "NormalDistributionsTransform, steps of 0.5 m at most, the origin moved to the query; no threads", [&](const Eigen::Matrix4d& guess) { return ndt_of(query, map, guess); });
}

void icp_point(const bench::Arguments& args) {
  const Cloud::Ptr query = cloud(args, "query_thin.f32");
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  refined(args, "IterativeClosestPoint; no threads", [&](const Eigen::Matrix4d& guess) { return icp_of_points(query, map, guess); });
}

void icp_plane(const bench::Arguments& args) {
  const Oriented::Ptr query = oriented(*cloud(args, "query_thin.f32"), *normals(args, "query_normals.f32"));
  const Oriented::Ptr map = oriented(*cloud(args, "map_thin.f32"), *normals(args, "map_normals.f32"));
  refined(args, "IterativeClosestPointWithNormals; no threads", [&](const Eigen::Matrix4d& guess) {
    pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal, double> icp;
    icp.setInputSource(query);
    icp.setInputTarget(map);
    return icp_from(icp, guess);
  });
}

void gicp(const bench::Arguments& args) {
  const Cloud::Ptr query = cloud(args, "query_thin.f32");
  const Cloud::Ptr map = cloud(args, "map_thin.f32");
  refined(args, "GeneralizedIterativeClosestPoint in double precision, the origin moved to the query; no threads", [&](const Eigen::Matrix4d& guess) {
    pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ, double> icp;
    icp.setCorrespondenceRandomness(NEIGHBOURS);
    icp.setMaxCorrespondenceDistance(PAIRS_WITHIN);
    icp.setMaximumIterations(ICP_ITERATIONS);
    // Here they bound the change of each entry of the matrix.
    icp.setTransformationEpsilon(STEP);
    icp.setRotationEpsilon(TURN);
    return aligned_there(icp, query, map, guess);
  });
}

void chain(const bench::Arguments& args) {
  const Cloud::Ptr raw_query = cloud(args, "query_0.f32");
  const Cloud::Ptr raw_map = cloud(args, "map.f32");
  const double v = bench::setting(args, "voxel");
  bench::measure(
      args, "normals of 20 neighbours, all nearest matches, ICP from point to point",
      [&] {
        const Described query = described(raw_query, v, args.threads);
        const Described map = described(raw_map, v, args.threads);
        pcl::Indices of_query, of_map;
        const pcl::CorrespondencesPtr matches = matches_of(query.features, map.features);
        for (const auto& match : *matches) {
          of_query.push_back(match.index_query);
          of_map.push_back(match.index_match);
        }
        const Eigen::Matrix4d coarse = pose_of(chosen(*query.keypoints, of_query), chosen(*map.keypoints, of_map), v, args.threads);
        return icp_of_points(query.thin, map.thin, ndt_of(query.thin, map.thin, coarse));
      },
      show_pose);
}

}  // namespace stages
