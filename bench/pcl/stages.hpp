// PCL's stages and the steps that several of them take.
#pragma once

#include <pcl/correspondence.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Core>
#include <runner.hpp>

namespace stages {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Features = pcl::PointCloud<pcl::FPFHSignature33>;

constexpr int NEIGHBOURS = 20;

// Loading and showing.
Cloud::Ptr cloud(const bench::Arguments& args, const std::string& name);
Normals::Ptr normals(const bench::Arguments& args, const std::string& name);
pcl::Indices indices(const bench::Arguments& args, const std::string& name);
Cloud::Ptr chosen(const Cloud& cloud, const pcl::Indices& indices);
bench::Output show(const pcl::Indices& indices);

// Steps. `v` is the voxel size.
pcl::Indices inliers(const Cloud::Ptr& cloud);
Cloud::Ptr thinned(const Cloud::Ptr& cloud, double v);
Normals::Ptr normals_of(const Cloud::Ptr& cloud, int threads);
pcl::Indices keypoints_of(const Cloud::Ptr& cloud, double v, int threads);
Features::Ptr features_of(const Cloud::Ptr& points, const Cloud::Ptr& cloud, const Normals::Ptr& normals, double v, int threads);
pcl::CorrespondencesPtr matches_of(const Features::Ptr& query, const Features::Ptr& map, bool mutual = false);
Eigen::Matrix4d pose_of(const Cloud::Ptr& query, const Cloud::Ptr& map, double v, int threads);

// Stages.
void read_pcd_ascii(const bench::Arguments& args);
void read_pcd_binary(const bench::Arguments& args);
void read_pcd_compressed(const bench::Arguments& args);
void read_ply(const bench::Arguments& args);
void voxel(const bench::Arguments& args);
void outliers(const bench::Arguments& args);
void tree(const bench::Arguments& args);
void nearest(const bench::Arguments& args);
void knn(const bench::Arguments& args);
void radius(const bench::Arguments& args);
void normals_knn(const bench::Arguments& args);
void normals_radius(const bench::Arguments& args);
void iss(const bench::Arguments& args);
void fpfh_all(const bench::Arguments& args);
void fpfh_keypoints(const bench::Arguments& args);
void match(const bench::Arguments& args);
void match_mutual(const bench::Arguments& args);
void ransac(const bench::Arguments& args);
void ndt(const bench::Arguments& args);
void icp_point(const bench::Arguments& args);
void icp_plane(const bench::Arguments& args);
void gicp(const bench::Arguments& args);
void chain(const bench::Arguments& args);

}  // namespace stages
