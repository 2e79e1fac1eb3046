import{a,b,c}from"./chunk-QZI4MGT3.js";import"./chunk-NWKU5IXX.js";import"./chunk-LRI5BHGM.js";export{c as Live,b as LiveFigures,a as WALL};
