import"./chunk-KHNENPYX.js";import{O as t,y as i}from"./chunk-EXJ3EDRR.js";function n(){return i(t,{title:"Train",text:"This page is being built."})}export{n as Train};
