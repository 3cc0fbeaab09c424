"""Grasping with two tactile fingers in MuJoCo: will the object be held?"""
