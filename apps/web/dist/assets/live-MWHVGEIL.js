import{a,b,c}from"./chunk-K6AOBYDF.js";import"./chunk-TFOQRYPF.js";import"./chunk-WBAEH5L4.js";export{c as Live,b as LiveFigures,a as WALL};
